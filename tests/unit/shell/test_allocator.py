"""Large blocks in a process of their own: what a test leaves set would be there for the others."""

import subprocess
import sys

import pytest

SCRIPT = """
import sys
from autonomy.shell.allocator import keep_compact
if not (keep_compact() if sys.argv[1] == "apart" else True):
    sys.exit("no mallopt")
def heap_kb():
    rows = open("/proc/self/smaps").read().split("[heap]")[1]
    return int(rows.partition("Rss:")[2].split()[0])
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


def holes_kb(way: str) -> int:
    done = subprocess.run([sys.executable, "-c", SCRIPT, way], capture_output=True, text=True, check=False)
    if "no mallopt" in done.stderr:
        pytest.skip("this C library has no mallopt")
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks Linux how large the heap is")
def test_freed_arrays_leave_no_holes_between_those_that_stay() -> None:
    assert holes_kb("apart") < 200
    assert holes_kb("as it is") > 1000, "else this would prove nothing"
