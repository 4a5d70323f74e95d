"""Sections of a bridge's configuration."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator
from pydantic_core import PydanticCustomError

from autonomy.bridge.patterns import Columns, Pattern, PatternError, Reader, Sentence
from autonomy.config import SigningSection
from autonomy.config.file import shown
from autonomy.config.sections.section import Conflict, Section
from autonomy.config.types import ENDPOINT_FORMS, Endpoint, Finite, FolderPath, NonNegative, Positive
from autonomy.mavlink.companion import BRIDGE_COMPONENT

LONGEST_LAG_S = 60.0
"""Of hose and response together; the service knows for so long where the boat was."""

_NAME = r"^[!-~]{1,10}$"


def _field(value: Any) -> int | str:
    if (isinstance(value, int) and not isinstance(value, bool) and value >= 1) or (
        isinstance(value, str) and value
    ):
        return value
    raise PydanticCustomError("field", "names no field (got {value})", {"value": shown(value)})


FieldName = Annotated[int | str, PlainValidator(_field)]


class InstrumentSection(Section):
    """The instrument and its port."""

    name: str = Field(
        default="instrument",
        pattern=r"^[A-Za-z0-9_-]{1,16}$",
        description="what it is called in the log, in words to the operator and in the names of its files",
        json_schema_extra={"allowed": "1 to 16 letters, digits, - and _"},
    )
    endpoint: Endpoint = Field(
        description="where its lines come from",
        json_schema_extra={"allowed": ENDPOINT_FORMS},
    )
    data_bits: Literal[7, 8] = Field(
        default=8,
        description="bits of a character; 7: the eighth, which is the parity of older instruments, is not looked at",
    )
    warm_up_s: NonNegative = Field(
        default=0.0,
        description="how long nothing is sent after it was switched on: after its first line, and after each silence",
    )
    silence_s: Positive = Field(
        default=10.0, description="time without a line after which it counts as silent, and as switched off"
    )


class LineSection(Section):
    """What a line looks like: exactly one of columns, pattern and sentence."""

    separator: Annotated[str, Field(min_length=1, max_length=8)] = Field(
        default=",",
        description="what stands between columns, space around it being ignored; ' ' is any amount of space",
        json_schema_extra={"allowed": "1 to 8 characters"},
    )
    columns: Annotated[int, Field(ge=1, le=200)] | None = Field(
        default=None,
        description="how many columns a whole line has; lines with more or fewer are not read",
    )
    pattern: str | None = Field(
        default=None,
        min_length=1,
        max_length=1000,
        description="regular expression with named groups, (?P<name>…), that all of a line must match",
    )
    sentence: str | None = Field(
        default=None,
        pattern=r"^(?:[A-Z]{3}|[A-Z0-9]{5}|P[A-Z0-9]{2,14})$",
        description="NMEA 0183 sentence: its formatter (MTW, of any talker), or all of its address (YXMTW, PSBE21)",
        json_schema_extra={"allowed": "3 or 5 capitals, or P and more"},
    )
    checksum: Literal["required", "if_present"] = Field(
        default="required", description="whether a sentence without a checksum is read; a wrong one never is"
    )
    decimal: Literal[".", ","] = Field(
        default=".",
        description="the decimal mark of its numbers",
        json_schema_extra={"allowed": "'.' or ','"},
    )
    example: str | None = Field(
        default=None,
        max_length=1000,
        description="a line of the instrument; the configuration is refused if it can't be read",
    )

    def conflicts(self) -> Iterator[Conflict]:
        """A line has one shape, and its example has it."""
        given = [key for key in ("columns", "pattern", "sentence") if getattr(self, key) is not None]
        allowed = "one of columns, pattern and sentence"
        if len(given) != 1:
            what = f"{' and '.join(given)} are given together" if given else "says nothing of a line's shape"
            yield Conflict((*given, "columns") if not given else tuple(given), what, allowed)
            return
        if self.decimal == "," and self.separator.strip() == "," and self.columns is not None:
            what = "can't be the separator too"
            yield Conflict(("decimal", "separator"), what, "separator: ';' or another")
        try:
            self.reader()
        except PatternError as error:
            yield Conflict((given[0],), str(error), "a regular expression with named groups, (?P<name>…)")

    def reader(self) -> Reader:
        """What finds the fields of such a line; PatternError if the regular expression can't be used."""
        if self.pattern is not None:
            return Pattern(self.pattern)
        if self.sentence is not None:
            return Sentence(self.sentence, checksum_required=self.checksum == "required")
        assert self.columns is not None
        return Columns(self.separator, self.columns)


class ValueSection(Section):
    """One value of a line, and what is sent of it."""

    field: FieldName = Field(
        description="where it stands: column (from 1), field of the sentence (from 1), or group of the pattern",
        json_schema_extra={"allowed": "a whole number of at least 1, or the name of a group"},
    )
    scale: Finite = Field(
        default=1.0, description="what is sent is scale times the number of the line, plus offset"
    )
    offset: Finite = Field(default=0.0, description="added after scaling")
    delay_s: NonNegative = Field(
        default=0.0,
        description="how long the water takes from the intake to the sensor: the hose's volume over the flow",
    )
    response_s: NonNegative = Field(
        default=0.0, description="time constant of the sensor's first-order response; 0: it has none"
    )
    response: Literal["shift", "sharpen"] = Field(
        default="shift",
        description="what is done about the response: shift, the value counts as of so much earlier; sharpen, the "
        "response is undone, which makes more of the noise",
    )
    window_s: Positive | None = Field(
        default=None, description="what is sharpened is smoothed over so long; null: over response_s"
    )

    def conflicts(self) -> Iterator[Conflict]:
        """Nothing is sharpened that responds at once; nothing may be older than the service remembers."""
        if self.scale == 0.0:
            yield Conflict(("scale",), "must not be 0", "a number other than 0")
        if self.response == "sharpen" and self.response_s == 0.0:
            yield Conflict(
                ("response", "response_s"), "sharpen needs response_s", "response_s above 0, or shift"
            )
        if self.window_s is not None and self.response != "sharpen":
            yield Conflict(("window_s", "response"), "is for response: sharpen", "null, or response: sharpen")
        if self.lag_s + (self.window_s or 0.0) > LONGEST_LAG_S:
            what = f"the water is more than {LONGEST_LAG_S:g} s old (got {self.lag_s:g} s)"
            yield Conflict(
                ("delay_s", "response_s"), what, "delay_s, response_s and window_s together at most 60"
            )

    @property
    def lag_s(self) -> float:
        """How old the water is, by and large, whose value is read."""
        return self.delay_s + self.response_s


class PumpSection(Section):
    """How the bridge knows that water flows past the sensors; nothing is sent while it does not."""

    field: FieldName | None = Field(
        default=None,
        description="where a line tells of the pump, or of the flow",
        json_schema_extra={"allowed": "a whole number of at least 1, the name of a group, or null"},
    )
    message_name: str | None = Field(
        default=None,
        pattern=_NAME,
        description="name of the NAMED_VALUE_FLOAT that tells of it, from any component of the vehicle",
        json_schema_extra={"allowed": "1 to 10 printable ASCII characters without spaces, or null"},
    )
    minimum: Finite | None = Field(default=None, description="it runs while the number is at least this")
    text: str | None = Field(
        default=None, min_length=1, max_length=64, description="it runs while the field says this"
    )
    flush_s: NonNegative | None = Field(
        default=None,
        description="how long nothing is sent after it began to run; null: the longest delay_s plus three times the "
        "longest response_s",
    )

    def conflicts(self) -> Iterator[Conflict]:
        """It is told in one way, and has one meaning."""
        if (self.field is None) == (self.message_name is None):
            yield Conflict(("field", "message_name"), "exactly one must be given", "field or message_name")
        if (self.minimum is None) == (self.text is None):
            yield Conflict(("minimum", "text"), "exactly one must be given", "minimum or text")
        elif self.text is not None and self.message_name is not None:
            yield Conflict(("text", "message_name"), "a message is a number", "minimum")


class LinkSection(Section):
    """The link to the vehicle."""

    endpoint: Endpoint = Field(
        description="where the vehicle, or its MAVLink router, is",
        json_schema_extra={"allowed": ENDPOINT_FORMS},
    )
    component_id: int = Field(
        default=BRIDGE_COMPONENT,
        ge=2,
        le=255,
        description="our MAVLink component; 158 is MAV_COMP_ID_PERIPHERAL; each bridge needs its own",
    )
    system_id: int | None = Field(
        default=None,
        ge=1,
        le=254,
        description="MAVLink system of the vehicle that is ours; null takes the first that is heard",
    )
    signing: SigningSection = SigningSection()


class RawSection(Section):
    """The recording of every line as it came, and of what was made of it."""

    enabled: bool = Field(default=True, description="whether lines are recorded")
    directory: FolderPath | None = Field(
        default=None,
        description="where to; null: raw in systemd's state directory, or else in "
        "~/.local/state/halocline/bridge-NAME, with instrument.name for NAME",
        json_schema_extra={"allowed": "the name of a folder, made if need be, or null"},
    )
    file_mb: float = Field(
        default=16.0,
        ge=0.01,
        le=1000,
        allow_inf_nan=False,
        description="size at which a new file is begun",
        json_schema_extra={"unit": "MB"},
    )
    total_mb: float = Field(
        default=500.0,
        ge=0.02,
        le=1_000_000,
        allow_inf_nan=False,
        description="size of all files together above which the oldest are removed",
        json_schema_extra={"unit": "MB"},
    )

    def conflicts(self) -> Iterator[Conflict]:
        """The newest file must not push itself out."""
        if self.total_mb < 2 * self.file_mb:
            what = f"must be at least twice raw.file_mb ({self.file_mb:g}) (got {self.total_mb:g})"
            yield Conflict(("total_mb", "file_mb"), what, "raw.total_mb >= 2 * raw.file_mb")
