"""Quality control of readings (QARTOD), streaming: flags for every reading, and counts of them."""

from autonomy.quality.flags import Check, Flag, Flags, Tally, aggregate, refused_by
from autonomy.quality.location import Waters
from autonomy.quality.stream import Judged, QualityControl, Reading

__all__ = [
    "Check",
    "Flag",
    "Flags",
    "Judged",
    "QualityControl",
    "Reading",
    "Tally",
    "Waters",
    "aggregate",
    "refused_by",
]
