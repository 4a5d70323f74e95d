"""Sections about readings: the probe, where and when they count, and their quality."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from autonomy.config.sections.section import Conflict, Section
from autonomy.config.types import (
    AREA_FORMS,
    LIMIT_FORMS,
    Area,
    Bound,
    FilePath,
    Finite,
    Limit,
    NonNegative,
    Positive,
)

Offset = Annotated[float, Field(ge=-200, le=200, allow_inf_nan=False)]


class SensorSection(Section):
    """The probe, as it names itself on the link."""

    message_name: str = Field(
        default="SALT",
        pattern=r"^[!-~]{1,10}$",
        description="name in the probe's NAMED_VALUE_FLOAT messages",
        json_schema_extra={"allowed": "1 to 10 printable ASCII characters without spaces"},
    )
    clock: Literal["own", "vehicle"] = Field(
        default="own",
        description="by which clock another component than the autopilot stamps its readings: own, which nobody knows "
        "here, so that they are timed by their arrival; vehicle, the autopilot's, as autonomy bridge does",
    )
    intake_forward_m: Offset = Field(
        default=0.0,
        description="how far the intake, or the probe, is ahead of the place whose position the autopilot tells; "
        "negative: behind it",
    )
    intake_starboard_m: Offset = Field(
        default=0.0, description="how far it is to starboard of that place; negative: to port"
    )
    variable: str = Field(
        default="sea_water_practical_salinity",
        min_length=1,
        description="what is measured, as a CF standard name; goes into what is published",
    )
    units: str = Field(
        default="1", min_length=1, description="unit of the readings, as CF writes it; goes with them"
    )
    minimum: Bound = Field(
        default=float("-inf"),
        description="readings below this are not learnt from",
        json_schema_extra={"unit": "the sensor's", "allowed": "a number, or -.inf for no limit"},
    )
    maximum: Bound = Field(
        default=float("inf"),
        description="readings above this are not learnt from",
        json_schema_extra={"unit": "the sensor's", "allowed": "a number, or .inf for no limit"},
    )
    transform: Literal["none", "log", "logit"] = Field(
        default="none",
        description="how readings are made Gaussian before learning: log for what spans decades, logit for what "
        "lies between two ends; maps and intervals stay in the sensor's unit",
    )
    transform_offset: float = Field(
        default=0.0,
        allow_inf_nan=False,
        description="added to readings before log, so that zeros have one",
        json_schema_extra={"unit": "the sensor's"},
    )
    transform_bounds: Annotated[tuple[Finite, Finite], Field(strict=False)] | None = Field(
        default=None,
        description="the two ends that readings under logit lie between",
        json_schema_extra={"unit": "the sensor's"},
    )

    def conflicts(self) -> Iterator[Conflict]:
        """An empty range would refuse every reading; a transform needs its own numbers and no others."""
        if not self.minimum < self.maximum:
            what = f"must be below sensor.maximum ({self.maximum:g}) (got {self.minimum:g})"
            yield Conflict(("minimum", "maximum"), what, "sensor.minimum < sensor.maximum")
        if self.transform_offset != 0.0 and self.transform != "log":
            what = f"is for sensor.transform log, not {self.transform}"
            yield Conflict(("transform_offset", "transform"), what, "0, or sensor.transform: log")
        bounds = self.transform_bounds
        if (bounds is not None) != (self.transform == "logit"):
            what = "is for sensor.transform logit, which needs it"
            yield Conflict(
                ("transform_bounds", "transform"), what, "two numbers with logit, null with the others"
            )
        elif bounds is not None and not bounds[0] < bounds[1]:
            what = f"must be a lower and an upper end (got {bounds[0]:g} and {bounds[1]:g})"
            yield Conflict(("transform_bounds",), what, "[lower, upper], e.g. [0, 40]")


class SurveySection(Section):
    """Where to survey. Files are GeoJSON, QGroundControl .plan, KML or KMZ, relative to the configuration file."""

    name: str = Field(
        default="survey",
        min_length=1,
        max_length=100,
        description="name of the survey; goes into what is published",
        json_schema_extra={"allowed": "1 to 100 characters"},
    )
    area: Area = Field(
        description="the survey area",
        json_schema_extra={"unit": "degrees", "allowed": AREA_FORMS},
    )
    keep_in: FilePath | None = Field(default=None, description="polygons that the vessel must not leave")
    keep_out: FilePath | None = Field(default=None, description="polygons that the vessel must not enter")
    land: FilePath | None = Field(
        default=None, description="polygons of land; without them all of the area is water"
    )
    depth: FilePath | None = Field(
        default=None,
        description="grid of depths: an ESRI ASCII grid (.asc) in degrees, which covers the area",
    )
    depth_positive: Literal["up", "down"] = Field(
        default="up", description="up: the grid has heights, negative below the water; down: it has depths"
    )
    minimum_depth_m: NonNegative = Field(
        default=2.0,
        description="where the grid has less water, or no value, is land; no tide is added or taken away",
    )
    standoff_m: NonNegative = Field(
        default=100.0, description="distance kept from land, shallows and keep-out"
    )
    passage_cells: int = Field(
        default=200,
        ge=20,
        le=400,
        description="cells along the longer side of the grid on which ways round land are sought",
    )


class SamplingSection(Section):
    """Which readings teach the model."""

    spacing_m: NonNegative = Field(
        default=0.0,
        description="readings closer than this to the last one learnt are skipped; 0 takes all of them",
    )
    minimum_speed_mps: NonNegative = Field(
        default=0.2,
        description="readings at a lower speed over ground are skipped: lying still teaches nothing new",
    )
    pairing_gap_s: Positive = Field(
        default=1.0, description="a reading further than this in time from a position fix is dropped"
    )


class QualitySection(Section):
    """Tests of every reading (QARTOD): flags that go with it, and which flags teach the model."""

    learn_from: Literal["good", "good_and_suspect"] = Field(
        default="good", description="flags of the readings that teach; failed and missing ones never do"
    )
    gap_s: Positive | None = Field(
        default=None,
        description="pause after which readings are missing, and a reading held back for the next one is let go; "
        "null: five times the usual interval, and at least 2 s",
    )
    suspect_minimum: Bound = Field(
        default=float("-inf"),
        description="readings below this are suspect; those below sensor.minimum fail",
        json_schema_extra={"unit": "the sensor's", "allowed": "a number, or -.inf for no limit"},
    )
    suspect_maximum: Bound = Field(
        default=float("inf"),
        description="readings above this are suspect; those above sensor.maximum fail",
        json_schema_extra={"unit": "the sensor's", "allowed": "a number, or .inf for no limit"},
    )
    location_margin_m: NonNegative | None = Field(
        default=None,
        description="readings further than this outside the survey area fail; null: the longer side of the area",
    )
    maximum_speed_mps: Positive | None = Field(
        default=None,
        description="places that take a higher speed to get to fail; null: eight times the usual speed, "
        "and at least 15 m/s",
    )
    spike_suspect: Limit | None = Field(
        default=None,
        description="height over both neighbours above which a reading is suspect; null: five standard deviations "
        "of the noise, estimated from the usual step between readings",
        json_schema_extra={"unit": "the sensor's", "allowed": LIMIT_FORMS},
    )
    spike_fail: Limit | None = Field(
        default=None,
        description="height over both neighbours above which a reading fails; null: ten standard deviations",
        json_schema_extra={"unit": "the sensor's", "allowed": LIMIT_FORMS},
    )
    rate_suspect_per_s: Limit | None = Field(
        default=None,
        description="change since the last good reading, per second, above which a reading is suspect; null: ten "
        "standard deviations of the noise or one of the last ten minutes' readings, whichever is more",
        json_schema_extra={"unit": "the sensor's, per second", "allowed": LIMIT_FORMS},
    )
    rate_fail_per_s: Limit | None = Field(
        default=None,
        description="change since the last good reading, per second, above which a reading fails; null: twice as much",
        json_schema_extra={"unit": "the sensor's, per second", "allowed": LIMIT_FORMS},
    )
    flat_tolerance: NonNegative = Field(
        default=0.0,
        description="readings that differ by no more than this count as the same",
        json_schema_extra={"unit": "the sensor's"},
    )
    flat_suspect_s: Limit | None = Field(
        default=None,
        description="time for which a reading may stay the same before it is suspect; null: four times as many "
        "repeats as the third longest of the last sixty runs of equal readings had and at least four, or not at all "
        "where most readings repeat the one before",
        json_schema_extra={"allowed": LIMIT_FORMS},
    )
    flat_fail_s: Limit | None = Field(
        default=None,
        description="time for which a reading may stay the same before it fails; null: twice as many repeats",
        json_schema_extra={"allowed": LIMIT_FORMS},
    )

    def conflicts(self) -> Iterator[Conflict]:
        """What fails is suspect too."""
        if not self.suspect_minimum < self.suspect_maximum:
            what = f"must be below quality.suspect_maximum ({self.suspect_maximum:g}) (got {self.suspect_minimum:g})"
            yield Conflict(
                ("suspect_minimum", "suspect_maximum"),
                what,
                "quality.suspect_minimum < quality.suspect_maximum",
            )
        for suspect, fail in (
            ("spike_suspect", "spike_fail"),
            ("rate_suspect_per_s", "rate_fail_per_s"),
            ("flat_suspect_s", "flat_fail_s"),
        ):
            low, high = getattr(self, suspect), getattr(self, fail)
            if low is not None and high is not None and low > high:
                what = f"must be at most quality.{fail} ({high:g}) (got {low:g})"
                yield Conflict((suspect, fail), what, f"quality.{suspect} <= quality.{fail}")
