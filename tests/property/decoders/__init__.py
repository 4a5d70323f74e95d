"""What reads bytes from outside: each with sound inputs, and with the only errors that it may answer others with."""

from . import areas, ashore, autopilot, files, instrument, kept
from .decoder import Decoder

__all__ = ["DECODERS", "Decoder"]

DECODERS: dict[str, Decoder] = {
    **autopilot.DECODERS,
    **ashore.DECODERS,
    **kept.DECODERS,
    **files.DECODERS,
    **instrument.DECODERS,
    **areas.DECODERS,
}
