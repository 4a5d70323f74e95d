"""Memory of a process of its own: what a test leaves set would be there for the others."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="asks Linux how large the heap is"
)

HEAP = """
import sys
from autonomy.shell.allocator import give_back, keep_compact
if sys.argv[1] == "apart" and not keep_compact():
    sys.exit("no mallopt")
def heap_kb():
    rows = open("/proc/self/smaps").read().split("[heap]")[1]
    return int(rows.partition("Rss:")[2].split()[0])
"""
LARGE_BLOCKS = """
import numpy as np
before = heap_kb()
large, small = [], []
for _ in range(30):
    large.append(np.ones(250_000 // 8))
    large.clear()
    large += [np.ones(250_000 // 8) for _ in range(8)]
    small.append(np.ones(1_500))
large.clear()
print(heap_kb() - before - 12 * len(small))
"""
HOLES = """
before = heap_kb()
freed, kept = [], []
for _ in range(400):
    freed.append(bytearray(b"x" * 60_000))
    kept.append(bytearray(b"x" * 1_000))
freed.clear()
left = heap_kb() - before
give_back()
print(left, heap_kb() - before)
"""
HOLES_KB = 400 * 60_000 // 1024


def told(way: str, script: str) -> list[int]:
    done = subprocess.run(
        [sys.executable, "-c", HEAP + script, way], capture_output=True, text=True, check=False
    )
    if "no mallopt" in done.stderr:
        pytest.skip("this C library has no mallopt")
    assert done.returncode == 0, done.stderr
    return [int(word) for word in done.stdout.split()]


def test_freed_arrays_leave_no_holes_between_those_that_stay() -> None:
    assert told("apart", LARGE_BLOCKS)[0] < 200
    assert told("as it is", LARGE_BLOCKS)[0] > 1000, "else this would prove nothing"


def test_the_holes_that_small_blocks_leave_are_given_back() -> None:
    """Blocks too small to have pages of their own, freed between others that stay."""
    left_kb, after_kb = told("apart", HOLES)
    assert left_kb > 0.7 * HOLES_KB, "else this would prove nothing"
    # What stays is 400 kB, each kilobyte in a page or two of its own.
    assert after_kb < 0.25 * HOLES_KB
