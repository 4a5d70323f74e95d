"""How the C library keeps the memory of a process that runs for months."""

import ctypes

_M_MMAP_THRESHOLD = -3  # malloc.h
_LARGE_BYTES = 128 * 1024


def keep_large_blocks_apart() -> bool:
    """Have each large block returned to the system when it is freed; whether the C library can (glibc does).

    By itself glibc takes large blocks from its heap as soon as one was freed: the small ones that come to lie between
    the arrays of re-estimates and plans then keep the holes that these leave. In 1.5 million simulated seconds holes
    of 3.6 MB came together.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    return mallopt is not None and bool(mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES))
