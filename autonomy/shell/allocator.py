"""How the C library keeps the memory of a process that runs for months (glibc's; others are left as they are)."""

import ctypes

GIVE_BACK_S = 3600.0
"""So often is `give_back` called."""

_M_MMAP_THRESHOLD = -3  # malloc.h
_M_ARENA_MAX = -8
_LARGE_BYTES = 128 * 1024
_ARENAS = 2


def keep_compact() -> bool:
    """Have each large block returned to the system when it is freed, and few heaps; whether the C library can.

    By itself glibc takes large blocks from its heap as soon as one was freed: the small ones that come to lie between
    the arrays of re-estimates and plans then keep the holes that these leave. In 1.5 million simulated seconds holes
    of 3.6 MB came together. And each thread gets a heap of its own, with holes of its own.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    return mallopt is not None and all(
        [mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES), mallopt(_M_ARENA_MAX, _ARENAS)]
    )


def give_back() -> None:
    """Return the free pages inside the heaps to the system; takes less than a millisecond."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(ctypes.c_size_t(0))
