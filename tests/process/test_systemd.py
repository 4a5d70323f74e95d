"""The unit on a real systemd, in a container with the simulator beside it: `make systemd-test` boots one.

The container sees this machine's files below a layer of its own, which is thrown away; its network is its own too.
"""

import contextlib
import os
import shutil
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

sys.path.insert(0, str(Path(__file__).parent))
from at_sea import VESSEL, configure
from processes import Processes, Running, wait_until

pytestmark = pytest.mark.process

REPOSITORY = Path(__file__).parents[2]
UNIT = "halocline@boat1.service"
LINK, OPERATOR, SHORE = "127.0.0.1:14550", "127.0.0.1:5760", "tcp/127.0.0.1:7447"
EXPLORING = "exploring: in AUTO under our mission"
PYTHON = "/opt/halocline/bin/python"
BRIDGE = """\
instrument: {name: probe, endpoint: "udpin:127.0.0.1:5600"}
line: {columns: 1}
values: {SALT: {field: 1}}
mavlink: {endpoint: "udpout:127.0.0.1:14570"}
"""
BOOT = """
mount -t overlay overlay -o lowerdir=/,upperdir="$1"/upper,workdir="$1"/work "$1"/root || exit 9
exec systemd-nspawn --quiet --boot --register=no --keep-unit --private-network --console=pipe --machine=halocline \
    --directory="$1"/root --bind-ro="$2":/opt/python --bind-ro="$3":/opt/packages --bind-ro="$4":/opt/source \
    systemd.unit=basic.target
"""
LIBRARY = "LD_LIBRARY_PATH=/opt/python/lib"
OPERATE = f"import asyncio; from sim.operator import Operator; asyncio.run(Operator('tcp:{OPERATOR}').run())"


class Machine:
    """A container, as its `systemd-nspawn` runs it; `unit` is the one that is asked about."""

    unit = UNIT

    def __init__(self, container: Running) -> None:
        self._children = Path(f"/proc/{container.pid}/task/{container.pid}/children")

    def run(self, *words: str, check: bool = True) -> str:
        """What a command inside says."""
        leader = (self._children.read_text().split() or ["none"])[0]
        inside = ("nsenter", "-t", leader, "-a", *words)
        done = subprocess.run(inside, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0 or not check, f"{words}: {done.stdout}{done.stderr}"
        return done.stdout.strip()

    def show(self, *names: str) -> dict[str, str]:
        """Properties of the unit."""
        said = self.run("systemctl", "show", self.unit, *(f"--property={name}" for name in names))
        return dict(line.split("=", 1) for line in said.splitlines())

    @property
    def journal(self) -> str:
        """What the unit has said, and systemd of it, all starts together."""
        return self.run("journalctl", "--no-pager", "--output=cat", "--unit", self.unit)

    def wait_for(self, words: str, count: int = 1, within_s: float = 120.0) -> None:
        """Wait until the unit's journal holds these words `count` times."""
        wait_until(lambda: self.journal.count(words) >= count, within_s, f"{words!r} {count} times")

    def is_booted(self) -> bool:
        """Whether basic.target is reached."""
        return self.run("systemctl", "is-active", "basic.target", check=False) == "active"


def lay_out(folder: Path) -> None:
    """The container's own layer: the service as the unit file says to install it, and its configuration."""
    for name in ("upper", "work", "root"):
        (folder / name).mkdir()
    etc, opt = folder / "upper/etc", folder / "upper/opt/halocline"
    for place in (etc / "systemd/system", etc / "halocline", opt / "bin"):
        place.mkdir(parents=True)
    (etc / "machine-id").write_text(uuid.uuid4().hex + "\n")
    shutil.copy(REPOSITORY / "systemd" / "halocline@.service", etc / "systemd/system")
    configure(etc / "halocline", f"udpin:{LINK}", [SHORE]).rename(etc / "halocline/boat1.yaml")
    shutil.copy(REPOSITORY / "systemd" / "halocline-bridge@.service", etc / "systemd/system")
    (etc / "halocline/bridge-probe.yaml").write_text(BRIDGE)
    # A second vehicle, whose link is signed.
    second = "halocline@boat2.service"
    vehicle = {"name": "boat2"}
    configure(etc / "halocline", "udpin:127.0.0.1:14560", vehicle=vehicle).rename(
        etc / "halocline/boat2.yaml"
    )
    secret = etc / "halocline/boat2.signing"
    secret.touch(0o600)
    secret.write_text("a passphrase that nobody has thought up\n")
    drop_ins = etc / "systemd/system" / f"{second}.d"
    drop_ins.mkdir()
    shutil.copy(REPOSITORY / "systemd" / "signing.conf", drop_ins)
    # A Python that is somewhere else than it was built for looks for its library there.
    for unit in ("halocline", "halocline-bridge"):
        drop_in = etc / f"systemd/system/{unit}@.service.d/python.conf"
        drop_in.parent.mkdir()
        drop_in.write_text(f"[Service]\nEnvironment={LIBRARY}\n")
    # A virtual environment as `python -m venv` makes it; the packages are those of the one that runs this test.
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    packages = opt / "lib" / version / "site-packages"
    packages.mkdir(parents=True)
    (packages / "halocline.pth").write_text("/opt/source\n/opt/packages\n")
    (opt / "pyvenv.cfg").write_text("home = /opt/python/bin\ninclude-system-site-packages = false\n")
    (opt / "bin/python").symlink_to(f"/opt/python/bin/{version}")
    program = opt / "bin/autonomy"
    program.write_text(f"#!{PYTHON}\nfrom autonomy.cli import entry\n\nentry()\n")
    program.chmod(0o755)
    for place in (folder, *folder.rglob("upper/**/")):
        place.chmod(0o755)


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    if "HALOCLINE_BOOT" not in os.environ:
        pytest.skip("boots a container: make systemd-test")
    if os.geteuid() != 0:
        pytest.skip("only root can boot a container")
    if shutil.which("systemd-nspawn") is None:
        pytest.skip("systemd-nspawn is not installed (Debian: systemd-container)")
    lay_out(tmp_path)
    packages = Path(yaml.__file__).parents[1]
    with Processes() as processes:
        shared = map(str, (tmp_path, sys.base_prefix, packages, REPOSITORY))
        words = ("unshare", "--mount", "--propagation", "private", "sh", "-c", BOOT, "sh", *shared)
        container = processes.program(*words)
        booted = Machine(container)
        try:
            container.wait_until(booted.is_booted, 120.0, "basic.target")
            yield booted
        finally:
            with contextlib.suppress(AssertionError, subprocess.TimeoutExpired):
                print(booted.journal)
                booted.run("systemctl", "poweroff", "--force", "--force", check=False)
            with contextlib.suppress(AssertionError):
                container.wait(30.0)


def start_sea(machine: Machine) -> None:
    """The simulated vessel, its operator and somebody ashore, as transient units."""
    vessel = (*("-m", "sim", "vessel", "--listen", f"udpout:{LINK}", "--listen", f"tcp:{OPERATOR}"), *VESSEL)
    shore = ("-m", "autonomy", "shore", "watch", "--listen", SHORE)
    for name, words in (("vessel", vessel), ("operator", ("-c", OPERATE)), ("shore", shore)):
        machine.run("systemd-run", "--collect", f"--unit={name}", "-E", LIBRARY, PYTHON, *words)


@pytest.mark.timeout(900)
def test_the_unit_on_a_booted_systemd(machine: Machine) -> None:
    # It is started only when it says that it is ready.
    begun = time.monotonic()
    machine.run("systemctl", "start", UNIT)
    print(f"READY after {time.monotonic() - begun:.1f} s")
    waiting = "waiting_for_vehicle: nothing heard from the autopilot yet"
    wait_until(lambda: machine.show("StatusText")["StatusText"].startswith(waiting), what="its status")
    shown = machine.show("ActiveState", "SubState", "MainPID", "WatchdogUSec", "NRestarts")
    main = int(shown.pop("MainPID"))
    assert shown == {
        "ActiveState": "active",
        "SubState": "running",
        "WatchdogUSec": "10s",
        "NRestarts": "0",
    }
    assert machine.show("StartLimitIntervalUSec") == {"StartLimitIntervalUSec": "0"}

    start_sea(machine)
    machine.wait_for(EXPLORING)
    machine.wait_for("shore: connected")
    assert_confined(machine, main)

    # Killed without a word: started again by systemd, and knows what it knew.
    machine.run("systemctl", "kill", "--kill-who=main", "--signal=KILL", UNIT)
    begun = time.monotonic()
    machine.wait_for("resumed after", 1)
    machine.wait_for(EXPLORING, 2)
    print(f"explores again {time.monotonic() - begun:.1f} s after kill -9")
    assert machine.show("NRestarts", "Result") == {"NRestarts": "1", "Result": "success"}

    # A loop that no longer turns: the watchdog strikes.
    time.sleep(3.0)
    machine.run("systemctl", "kill", "--kill-who=main", "--signal=STOP", UNIT)
    begun = time.monotonic()
    machine.wait_for("Watchdog timeout (limit 10s)!")
    machine.wait_for("resumed after", 2)
    machine.wait_for(EXPLORING, 3)
    print(f"explores again {time.monotonic() - begun:.1f} s after SIGSTOP")
    assert "Fatal Python error: Aborted" in machine.journal
    assert machine.show("NRestarts") == {"NRestarts": "2"}
    assert "nothing is known yet" in machine.journal.partition("resumed after")[0]
    assert machine.journal.count("nothing is known yet") == 1

    # Stopped in order: it says so, and nothing is left.
    begun = time.monotonic()
    machine.run("systemctl", "stop", UNIT)
    print(f"stopped in {time.monotonic() - begun:.1f} s")
    ended = machine.show("ActiveState", "Result", "ExecMainStatus")
    assert ended == {"ActiveState": "inactive", "Result": "success", "ExecMainStatus": "0"}
    assert "autonomy run" not in (left := machine.run("ps", "-eww", "-o", "args"))
    assert "autonomy.shell" not in left
    machine.run("systemctl", "start", UNIT)
    machine.wait_for("resumed after", 3)
    machine.run("systemctl", "stop", UNIT)

    assert_reaches_its_port(machine)
    assert_has_its_secret(machine)

    # A wrong configuration is told once, not every two seconds.
    machine.run("sh", "-c", "echo 'vehicle: {name: 7, colour: red}' > /etc/halocline/boat1.yaml")
    machine.run("systemctl", "start", UNIT, check=False)
    time.sleep(6.0)
    failed = machine.show("ActiveState", "Result", "ExecMainStatus", "NRestarts")
    assert failed == {
        "ActiveState": "failed",
        "Result": "exit-code",
        "ExecMainStatus": "78",
        "NRestarts": "0",
    }
    assert machine.journal.count("vehicle.colour") == 1


@pytest.mark.timeout(600)
def test_the_bridges_unit_on_a_booted_systemd(machine: Machine) -> None:
    machine.unit = "halocline-bridge@probe.service"
    machine.run("systemctl", "start", machine.unit)
    wait_until(lambda: "instrument is silent" in machine.show("StatusText")["StatusText"], what="its status")
    words = ("--instrument", "udpout:127.0.0.1:5600", "--listen", "udpin:127.0.0.1:14570")
    machine.run(
        "systemd-run", "--collect", "--unit=vessel", "-E", LIBRARY, PYTHON, "-m", "sim", "vessel", *words
    )
    machine.wait_for("probe: sending")

    # It is nobody, and what it writes is its own.
    (user,) = machine.run("ps", "-eww", "-o", "user:40,args").split("autonomy bridge")[0].splitlines()[-1:]
    assert user.split()[0] not in ("root", "nobody")
    (recorded,) = machine.run("find", "/var/lib/halocline-bridge/probe/raw", "-name", "*.ndjson").splitlines()
    wait_until(lambda: '"sent"' in machine.run("tail", "-n", "1", recorded), what="a line that was sent")

    # A loop that no longer turns: the watchdog strikes.
    machine.run("systemctl", "kill", "--kill-who=main", "--signal=STOP", machine.unit)
    machine.wait_for("Watchdog timeout (limit 10s)!")
    machine.wait_for("probe: sending", 2)

    # Stopped in order; a wrong configuration is told once.
    machine.run("systemctl", "stop", machine.unit)
    assert machine.show("ActiveState", "Result") == {"ActiveState": "inactive", "Result": "success"}
    machine.run("sh", "-c", "echo 'line: {colour: red}' > /etc/halocline/bridge-probe.yaml")
    machine.run("systemctl", "start", machine.unit, check=False)
    time.sleep(6.0)
    failed = machine.show("ActiveState", "ExecMainStatus", "NRestarts")
    assert failed == {"ActiveState": "failed", "ExecMainStatus": "78", "NRestarts": "0"}
    assert machine.journal.count("line.colour") == 1


def assert_confined(machine: Machine, main: int) -> None:
    """It is nobody, its worker is nicer, and its state is its own."""
    processes = [
        line.split(None, 2)
        for line in machine.run("ps", "-eww", "-o", "user:40,nice,args").splitlines()
        if "autonomy run" in line or "autonomy.shell" in line
    ]
    users = {user for user, _, _ in processes}
    assert len(processes) == 2
    assert len(users) == 1
    assert users.isdisjoint({"root", "nobody"})
    assert sorted(int(nice) for _, nice, _ in processes) == [0, 10]
    status = machine.run("cat", f"/proc/{main}/status")
    assert "NoNewPrivs:\t1" in status
    assert "CapBnd:\t0000000000000000" in status
    state = "/var/lib/private/halocline/boat1"
    assert machine.run("stat", "-c", "%a", state) == "700"
    assert set(machine.run("ls", state).split()) == {"checkpoint", "journal"}
    files = machine.run("find", state, "-type", "f", "-printf", "%m ").split()
    assert set(files) == {"600"}


def assert_reaches_its_port(machine: Machine) -> None:
    """What belongs to the drop-in's group can be read, although the group has no name among the service's users."""
    machine.run("sh", "-c", "echo port > /run/port && chgrp dialout /run/port && chmod 640 /run/port")
    confined = ("--property=DynamicUser=yes", "--property=PrivateUsers=yes")
    ask = ("systemd-run", "--quiet", "--collect", "--pipe", "--wait", *confined)
    assert machine.run(*ask, "--property=SupplementaryGroups=dialout", "cat", "/run/port") == "port"
    assert machine.run(*ask, "cat", "/run/port", check=False) == ""


def assert_has_its_secret(machine: Machine) -> None:
    """A key that belongs to root and is nobody else's to read comes to the service through systemd."""
    second = "halocline@boat2.service"
    machine.run("systemctl", "start", second)
    assert machine.run("systemctl", "is-active", second) == "active"
    assert machine.run("stat", "-c", "%U %a", "/etc/halocline/boat2.signing") == "root 600"
    main = machine.run("systemctl", "show", second, "--property=MainPID", "--value")
    environment = machine.run("sh", "-c", f"tr '\\0' '\\n' < /proc/{main}/environ").splitlines()
    assert f"HALOCLINE_MAVLINK__SIGNING__KEY_FILE=/run/credentials/{second}/signing" in environment
    machine.run("systemctl", "stop", second)
    assert machine.run("systemctl", "show", second, "--property=Result") == "Result=success"
