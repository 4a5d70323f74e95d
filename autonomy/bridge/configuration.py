"""The configuration of a bridge: which instrument, what its lines look like, what is made of them."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from autonomy.bridge.patterns import LineError, Reader, number
from autonomy.bridge.sections import (
    InstrumentSection,
    LineSection,
    LinkSection,
    PumpSection,
    RawSection,
    ValueSection,
)
from autonomy.config import ConfigurationError, LoggingSection, Problem
from autonomy.config.file import read_document
from autonomy.config.sections.section import Conflict, Section
from autonomy.config.translate import origin_at, translate
from autonomy.mavlink.signing import KeyFileError, read_key


class BridgeConfiguration(Section):
    """Everything a bridge depends on."""

    instrument: InstrumentSection
    line: LineSection
    values: Annotated[dict[str, ValueSection], Field(min_length=1, max_length=20)] = Field(
        description="what is sent, by the name of its NAMED_VALUE_FLOAT",
        json_schema_extra={"allowed": "a mapping of names (1 to 10 printable ASCII characters) to values"},
    )
    pump: PumpSection | None = Field(
        default=None, description="how the bridge knows that water flows; null: it always does"
    )
    mavlink: LinkSection
    raw: RawSection = RawSection()
    logging: LoggingSection = LoggingSection()

    def conflicts(self) -> Iterator[Conflict]:
        """Every field that is named exists; the example of a line holds them all, as numbers."""
        reader = self.line.reader()
        fields = {f"values.{name}.field": value.field for name, value in self.values.items()}
        if self.pump is not None and self.pump.field is not None:
            fields["pump.field"] = self.pump.field
        for key, field in fields.items():
            if (trouble := reader.why_not(field)) is not None:
                yield Conflict((key,), trouble, reader.fields)
        for name in self.values:
            if not (1 <= len(name) <= 10 and name.isascii() and name.isprintable() and " " not in name):
                what = f"is no name for a NAMED_VALUE_FLOAT ({len(name)} characters)"
                yield Conflict((f"values.{name}",), what, "1 to 10 printable ASCII characters without spaces")
        if self.pump is not None and self.pump.message_name in self.values:
            yield Conflict(("pump.message_name",), "is one of the values that are sent here", "another name")
        if (trouble := self._why_unreadable(reader)) is not None:
            yield Conflict(("line.example",), trouble, "a line that can be read, as the instrument sends it")

    def _why_unreadable(self, reader: Reader) -> str | None:
        """Why the example of a line can't be read; None if it can, or if there is none."""
        if self.line.example is None:
            return None
        try:
            found = reader.read(self.line.example.strip())
        except LineError as error:
            return f"can't be read: {error}"
        for name, value in self.values.items():
            if value.field not in found:
                return f"has no field {value.field}, which {name} is made of"
            try:
                number(found[value.field], self.line.decimal)
            except LineError as error:
                return f"field {value.field}, which {name} is made of: {error}"
        return None

    @property
    def flush_s(self) -> float:
        """How long nothing is sent after the pump began to run."""
        if self.pump is not None and self.pump.flush_s is not None:
            return self.pump.flush_s
        values = self.values.values()
        return max(each.delay_s for each in values) + 3.0 * max(each.response_s for each in values)


def load_bridge(path: Path | str, environment: Mapping[str, str] | None = None) -> BridgeConfiguration:
    """Read a bridge's configuration; names of files in it are relative to it. Its signing key is tried, too.

    Args:
        path: a YAML file.
        environment: of the process; None means this one's. It overrides nothing.

    Raises:
        ConfigurationError: its `problems` are all the mistakes, each with file, line, column and key.
    """
    document = read_document(path)
    base = Path(document.file).absolute().parent
    for section, key in ((("mavlink", "signing"), "key_file"), (("raw",), "directory")):
        holder: Any = document.data
        for part in section:
            holder = holder.get(part) if isinstance(holder, dict) else None
        if isinstance(holder, dict) and isinstance(holder.get(key), str):
            holder[key] = str(base / holder[key])
    try:
        configuration = BridgeConfiguration.model_validate(document.data)
    except ValidationError as error:
        found = [each.problem for each in translate(error, document, BridgeConfiguration)]
        raise ConfigurationError([*document.problems, *found]) from None
    problems = list(document.problems)
    try:
        read_key(configuration.mavlink.signing, os.environ if environment is None else environment)
    except KeyFileError as error:
        origin = origin_at(("mavlink", "signing", "key_file"), document)
        problems.append(Problem(origin, "mavlink.signing.key_file", str(error)))
    if problems:
        raise ConfigurationError(problems)
    return configuration
