"""The service on a disk that keeps it waiting: `python held_disk.py HOLD run --config FILE`.

Nothing is put on the disk as long as the file HOLD is there, and the service waits for that as long as it takes.
"""

import os
import sys
import time
from pathlib import Path

from autonomy import cli
from autonomy.shell import forethought

if __name__ == "__main__":
    hold, sync = Path(sys.argv[1]), os.fsync

    def waiting(descriptor: int) -> None:
        while hold.exists():
            time.sleep(0.01)
        sync(descriptor)

    os.fsync = waiting
    forethought.PATIENCE_S = 3600.0
    sys.exit(cli.main(sys.argv[2:]))
