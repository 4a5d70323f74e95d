"""The short form of these tests (the ordinary suite) and the long one (make accuracy)."""

import os
from collections.abc import Callable

LONG = os.environ.get("HALOCLINE_ACCURACY") == "long"

Say = Callable[[str], None]
"""Prints a line of figures, in the long form."""
