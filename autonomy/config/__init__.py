"""The configuration of a run: `load` reads it and names file, line, column and key of every mistake."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from autonomy.config.file import Document, KeyPath, dotted, read_document
from autonomy.config.overlay import apply_environment, apply_overrides
from autonomy.config.private import PrivateFileError, read_private
from autonomy.config.problems import ConfigurationError, Origin, Problem, Source
from autonomy.config.reference import holds_file, holds_folder, holds_secret, section_of
from autonomy.config.sections.learning import (
    LARGEST_CAPACITY,
    LEAST_CHOSEN_CAPACITY,
    Candidate,
    EstimationSection,
    HyperparametersSection,
    ModelSection,
)
from autonomy.config.sections.planning import BudgetSection, ExplorationSection, PlanningSection
from autonomy.config.sections.readings import QualitySection, SamplingSection, SensorSection, SurveySection
from autonomy.config.sections.section import Section
from autonomy.config.sections.service import (
    CheckpointSection,
    CommandsSection,
    JournalSection,
    LoggingSection,
    ShoreSection,
    TlsSection,
)
from autonomy.config.sections.vehicle import MavlinkSection, SigningSection, VehicleSection
from autonomy.config.translate import is_consequence, translate
from autonomy.config.tree import Configuration

__all__ = [
    "LARGEST_CAPACITY",
    "LEAST_CHOSEN_CAPACITY",
    "BudgetSection",
    "Candidate",
    "CheckpointSection",
    "CommandsSection",
    "Configuration",
    "ConfigurationError",
    "EstimationSection",
    "ExplorationSection",
    "HyperparametersSection",
    "JournalSection",
    "Loaded",
    "LoggingSection",
    "MavlinkSection",
    "ModelSection",
    "Origin",
    "PlanningSection",
    "Problem",
    "QualitySection",
    "SamplingSection",
    "Section",
    "SensorSection",
    "ShoreSection",
    "SigningSection",
    "SurveySection",
    "TlsSection",
    "VehicleSection",
    "load",
    "load_with_origins",
]

MAXIMUM_FINDINGS = 200
"""More mistakes than this in one file are counted, not listed."""

_FILE = "the name of a file that is there and may be read"


@dataclass(frozen=True)
class Loaded:
    """A configuration and the origin of every value that is not a default, by its path of keys."""

    configuration: Configuration
    origins: Mapping[tuple[str | int, ...], Origin]


def load(
    path: Path | str, environment: Mapping[str, str] | None = None, overrides: Sequence[str] = ()
) -> Configuration:
    """Read a configuration file; environment and options override it, in this order.

    Args:
        path: a YAML file.
        environment: variables such as HALOCLINE_MODEL__CAPACITY; None means this process's own.
        overrides: options such as `model.capacity=50`.

    Raises:
        ConfigurationError: its `problems` are all the mistakes, each with file, line, column and key.
    """
    return load_with_origins(path, environment, overrides).configuration


def load_with_origins(
    path: Path | str, environment: Mapping[str, str] | None = None, overrides: Sequence[str] = ()
) -> Loaded:
    """As `load`, and tells where each value comes from."""
    document = read_document(path)
    environment = os.environ if environment is None else environment
    apply_environment(document, environment, Configuration)
    apply_overrides(document, overrides, Configuration)
    _fill_empty_sections(document.data, Configuration)
    problems = list(document.problems)
    problems += _resolve_files(document, environment)
    try:
        configuration = Configuration.model_validate(document.data)
    except ValidationError as error:
        found = list(islice(translate(error, document, Configuration), MAXIMUM_FINDINGS))
        mistakes = sum(not is_consequence(each) for each in error.errors(include_url=False))
        if mistakes > len(found):
            what = f"{mistakes - len(found)} further mistakes are not listed"
            problems.append(Problem(Origin(Source.FILE, document.file), "", what))
        problems += [finding.problem for finding in found]
        problems += _conflicts_among_the_rest(document, {path for finding in found for path in finding.paths})
        raise ConfigurationError(problems) from None
    if problems:
        raise ConfigurationError(problems)
    return Loaded(configuration, document.origins)


def _fill_empty_sections(data: dict[str, Any], model: type[BaseModel]) -> None:
    """A section whose keys are all commented out reads as null; it means its defaults."""
    for name, field in model.model_fields.items():
        section = section_of(field)
        if section is None or name not in data:
            continue
        if data[name] is None and (field.is_required() or field.get_default() is not None):
            data[name] = {}
        if isinstance(data[name], dict):
            _fill_empty_sections(data[name], section)


def _resolve_files(document: Document, environment: Mapping[str, str]) -> Iterator[Problem]:
    """Make the names of files absolute, and look whether they are there, and private if they must be.

    Names in the file are relative to the file; names on the command line and in the environment are relative
    to the present directory, as everywhere on a command line.
    """
    base = Path(document.file).absolute().parent
    for path, values, field in _named_files(document.data, Configuration, ()):
        origin = document.origins[path]
        file = (base if origin.source is Source.FILE else Path.cwd()) / values[path[-1]]
        values[path[-1]] = str(file)
        if holds_secret(field):
            try:
                read_private(file, environment)
            except PrivateFileError as error:
                yield Problem(origin, dotted(path), str(error), "a file that only its owner may read")
        elif not holds_folder(field) and not _is_readable_file(file):
            yield Problem(origin, dotted(path), f"no readable file {str(file)!a}", _FILE)


def _named_files(
    values: Any, model: type[BaseModel], path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], dict[str, Any], FieldInfo]]:
    """Every name of a file or folder: its path, the mapping that it stands in, and its field."""
    if not isinstance(values, dict):
        return
    for name, field in model.model_fields.items():
        section = section_of(field)
        if section is not None:
            yield from _named_files(values.get(name), section, (*path, name))
        elif holds_file(field) and isinstance(values.get(name), str):
            yield (*path, name), values, field


def _is_readable_file(file: Path) -> bool:
    try:
        return file.is_file() and os.access(file, os.R_OK)
    except (OSError, ValueError):  # a name that no file system takes
        return False


def _conflicts_among_the_rest(document: Document, wrong: set[KeyPath]) -> list[Problem]:
    """Conflicts among the values that are right in themselves: pydantic looks for them only when all are."""
    data = {
        name: {key: value for key, value in section.items() if not _concerns((name, key), wrong)}
        for name, section in document.data.items()
        if isinstance(section, dict) and name in Configuration.model_fields
    }
    data["survey"] = {"area": [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]]}
    try:
        Configuration.model_validate(data)
    except ValidationError as error:
        return [
            finding.problem
            for finding in translate(error, document, Configuration)
            if not any(_concerns(path, wrong) for path in finding.paths)
        ]
    return []


def _concerns(path: KeyPath, wrong: set[KeyPath]) -> bool:
    return any(path[: len(other)] == other or other[: len(path)] == path for other in wrong)
