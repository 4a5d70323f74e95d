"""The made-up sea of a dry run: the process that it says it is, on the survey's own land."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import SensorSection
from autonomy.geometry import LocalFrame
from autonomy.planning.survey import SurveyArea
from sim.patchy import Levels, PatchyField

FRAME = LocalFrame(36.6, -122.0)
ISLAND = shapely.box(2000.0, 2000.0, 2600.0, 2600.0)
SURVEY = SurveyArea.from_geometry(FRAME, shapely.box(0.0, 0.0, 6000.0, 5000.0), land=ISLAND)
LENGTH_M = 900.0


def sea(seed: int = 0, **sensor: object) -> PatchyField:
    section = SensorSection.model_validate(sensor)
    return PatchyField(SURVEY, LENGTH_M, Levels.within(section), section, np.random.default_rng(seed))


def at(field: PatchyField, points_m: object) -> np.ndarray:
    degrees = FRAME.to_geodetic(np.asarray(points_m, dtype=float))
    return field.value(degrees[..., 0], degrees[..., 1], 0.0)


def test_covariances_are_those_of_the_process() -> None:
    """Of pairs of places, 40 km from each other; the mean of 3600 products is good to a twentieth or so."""
    corners = 4e4 * np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    lags_m = np.array([0.0, 450.0, 900.0, 1800.0])
    places = np.stack([corners + np.array([0.8, 0.6]) * lag_m for lag_m in lags_m])
    values = np.array([at(sea(seed), places) for seed in range(100)])
    found = np.mean(values[:, :1] * values, axis=(0, 2))
    u = np.sqrt(3.0) * lags_m / LENGTH_M
    assert found == pytest.approx((1.0 + u) * np.exp(-u), abs=0.1)


def test_land_is_the_surveys_to_the_metre() -> None:
    field = sea()
    inside, outside = (
        [(2001.0, 2300.0), (2599.0, 2599.0)],
        [(1999.0, 2300.0), (2601.0, 2300.0), (-500.0, 0.0)],
    )
    assert np.isnan(at(field, inside)).all()
    assert np.isfinite(at(field, outside)).all()
    lat_deg, lon_deg = FRAME.to_geodetic(inside[0])
    assert field.is_land(lat_deg, lon_deg)


def test_the_same_seed_is_the_same_sea() -> None:
    points_m = [(100.0, 100.0), (3000.0, 4000.0)]
    assert (at(sea(3), points_m) == at(sea(3), points_m)).all()
    assert (at(sea(3), points_m) != at(sea(4), points_m)).any()


LIMITS = st.floats(-1e6, 1e6).map(lambda value: round(value, 3))


@settings(deadline=None)
@given(
    low=LIMITS,
    width=st.floats(0.01, 1e6),
    has=st.sampled_from([("minimum", "maximum"), ("minimum",), ("maximum",)]),
)
def test_no_value_is_near_the_sensors_limits(low: float, width: float, has: tuple[str, ...]) -> None:
    limits = {"minimum": low, "maximum": low + width}
    section = SensorSection.model_validate({name: limits[name] for name in has})
    levels = Levels.within(section)
    far = np.array([levels.mean - 4.0 * levels.deviation, levels.mean + 4.0 * levels.deviation])
    assert levels.deviation > 0.0
    assert section.minimum < far[0] < far[1] < section.maximum


@pytest.mark.parametrize(
    "sensor",
    [
        {"transform": "log", "minimum": 0.01, "maximum": 100.0},
        {"transform": "log"},
        {"transform": "logit", "transform_bounds": [0.0, 40.0], "minimum": 0.0, "maximum": 40.0},
    ],
)
def test_values_are_what_the_transform_takes(sensor: dict[str, object]) -> None:
    x, y = np.meshgrid(np.linspace(0.0, 6000.0, 40), np.linspace(0.0, 5000.0, 40))
    values = at(sea(0, **sensor), np.stack([x, y], axis=-1))
    values = values[np.isfinite(values)]
    assert values.min() > 0.0
    assert values.max() < 100.0
    assert values.std() > 0.0
