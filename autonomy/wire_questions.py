"""What may be asked of a vehicle beside its newest values: pieces of what it told in order. See docs/wire.md."""

from dataclasses import dataclass

from autonomy.wire_kinds import WireError, brief


@dataclass(frozen=True)
class Piece:
    """A piece of the observations or of the log.

    Attributes:
        first: number of the first item wanted; a negative one counts from the end.
        count: how many are wanted at most.
    """

    first: int
    count: int

    @property
    def parameters(self) -> str:
        """As the parameters of a query."""
        return f"from={self.first};count={self.count}"


def wanted_piece(first: str | None, count: str | None) -> Piece | None:
    """The piece that a query's parameters `from` and `count` ask for; None if there are none.

    Raises:
        WireError: they are not whole numbers, or the count is none.
    """
    if first is None and count is None:
        return None
    return Piece(_whole("from", first or "", signed=True), _whole("count", count or "", signed=False))


def _whole(name: str, text: str, *, signed: bool) -> int:
    digits = text.removeprefix("-") if signed else text
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= 16):
        raise WireError(f"{name}: must be a whole number (got {brief(text)})")
    return int(text)
