"""The shore at the far end of a link of so many bits per second, in a network namespace of its own.

Start it with `unshare --net`: it makes a pair of virtual devices, starts the boat in another namespace with one of
them, and shapes both by `tc tbf`. After so many seconds it tells as JSON what has come, and when.

Arguments: bits per second of the link, the boat's rate limit, seconds between two readings, seconds.
"""

import json
import subprocess
import sys
import time
from pathlib import Path

from autonomy import wire
from autonomy.shore.subscriber import Subscriber

HERE = Path(__file__).parent
ADDRESS = "10.99.0.1"


def command(*words: str) -> bytes:
    """What a program says that has to succeed."""
    return subprocess.run(words, check=True, capture_output=True).stdout


def main() -> None:
    """See the module's description."""
    bits_per_s, rate, reading_s, seconds = sys.argv[1], sys.argv[2], sys.argv[3], float(sys.argv[4])
    command("ip", "link", "set", "lo", "up")
    command("ip", "link", "add", "name", "ashore", "type", "veth", "peer", "name", "aboard")
    program = (sys.executable, str(HERE / "thin_boat.py"), f"tcp/{ADDRESS}:7447", rate, reading_s)
    boat = subprocess.Popen(
        ["unshare", "--net", "sh", "-c", 'read go; exec "$@"', "-", *program], stdin=subprocess.PIPE
    )
    assert boat.stdin is not None
    inside = ("nsenter", f"--net=/proc/{boat.pid}/ns/net")
    while Path(f"/proc/{boat.pid}/ns/net").readlink() == Path("/proc/self/ns/net").readlink():
        time.sleep(0.05)
    command("ip", "link", "set", "dev", "aboard", "netns", str(boat.pid))
    shape = ("root", "tbf", "rate", f"{bits_per_s}bit", "burst", "1600", "limit", "6000")
    for where, device, address in (((), "ashore", f"{ADDRESS}/24"), (inside, "aboard", "10.99.0.2/24")):
        command(*where, "ip", "address", "add", address, "dev", device)
        command(*where, "ip", "link", "set", "dev", device, "up")
        command(*where, "tc", "qdisc", "add", "dev", device, *shape)
    models, readings, health = [], [], []

    def take(update) -> None:
        now = time.time()
        match update.value:
            case wire.ModelSnapshot(utc_s=utc_s) as model:
                models.append((now, utc_s, model.precision, len(model.model)))
            case tuple():
                readings.extend(one.model_time_s for one in update.value)
            case wire.HealthNotice(reason=reason):
                health.append((now, reason))

    begun = time.time()
    with Subscriber("boat1", listen=[f"tcp/{ADDRESS}:7447"], on_update=take, history=None):
        boat.stdin.write(b"go\n")
        boat.stdin.flush()
        time.sleep(seconds)
        (device,) = json.loads(command("ip", "-json", "-statistics", "link", "show", "dev", "ashore"))
    boat.stdin.close()
    boat.wait(20)
    json.dump(
        {
            "begun": begun,
            "ended": begun + seconds,
            "models": models,
            "readings": readings,
            "health": health,
            "bytes": device["stats64"]["rx"]["bytes"],
        },
        sys.stdout,
    )


if __name__ == "__main__":
    main()
