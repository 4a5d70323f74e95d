"""What all sections share: unknown keys are mistakes, and so are values that cannot be true together."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

from pydantic import BaseModel, ConfigDict, model_validator
from pydantic_core import PydanticCustomError


@dataclass(frozen=True)
class Conflict:
    """Values each allowed but not together; `keys` are dotted, relative to the section that says so."""

    keys: tuple[str, ...]
    what: str
    allowed: str


class Section(BaseModel):
    """A group of keys; unknown keys are mistakes."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    def conflicts(self) -> Iterator[Conflict]:
        """What cannot be true together."""
        yield from ()

    @model_validator(mode="after")
    def _without_conflicts(self) -> Self:
        found = tuple(self.conflicts())
        if found:
            text = "; ".join(f"{conflict.keys[0]}: {conflict.what}" for conflict in found)
            raise PydanticCustomError("conflict", "{text}", {"text": text, "conflicts": found})
        return self
