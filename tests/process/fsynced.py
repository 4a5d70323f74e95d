"""The service, noting what it has had put on the disk: `python fsynced.py NOTES run --config FILE`.

NOTES gets a line for each file that was synced: its inode, and how long it was before the sync began.
"""

import os
import sys

from autonomy import cli

if __name__ == "__main__":
    notes = os.open(sys.argv[1], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    sync = os.fsync

    def noting(descriptor: int) -> None:
        before = os.fstat(descriptor)
        sync(descriptor)
        os.write(notes, f"{before.st_ino} {before.st_size}\n".encode())

    os.fsync = noting
    sys.exit(cli.main(sys.argv[2:]))
