"""The bridge's unit: that systemd and the command line understand it, and that little is exposed."""

import argparse
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from autonomy.commands import bridge as bridge_command

FOLDER = Path(__file__).parents[3] / "systemd"
UNIT = FOLDER / "halocline-bridge@.service"


def assignments(file: Path) -> list[tuple[str, str]]:
    lines = [line.partition("=") for line in file.read_text().splitlines() if "=" in line and line[0] != "#"]
    return [(key, value) for key, _, value in lines]


def installed(folder: Path, *, serial: bool) -> Path:
    unit = folder / UNIT.name
    unit.write_text(
        UNIT.read_text().replace("/opt/halocline/bin/autonomy", shutil.which("true") or "/bin/true")
    )
    drop_in = folder / f"{UNIT.name}.d" / "serial.conf"
    drop_in.parent.mkdir()
    drop_in.write_text((FOLDER / "serial.conf").read_text() if serial else "")
    return unit


def analyzed(*words: str) -> "subprocess.CompletedProcess[str]":
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip("systemd-analyze is not installed")
    return subprocess.run([program, *words], capture_output=True, text=True, timeout=60, check=False)


def test_the_command_line_is_one_that_the_bridge_takes() -> None:
    (command,) = [value for key, value in assignments(UNIT) if key == "ExecStart"]
    program, verb, *words = shlex.split(command.replace("%i", "sbe45"))
    parser = argparse.ArgumentParser()
    bridge_command.add_arguments(parser)
    assert (Path(program).name, verb) == ("autonomy", "bridge")
    assert parser.parse_args(words).config == "/etc/halocline/bridge-sbe45.yaml"


def test_it_is_hardened_as_the_service_is() -> None:
    """Every line of the service's that takes something away, but for what its worker needs."""
    keys = ("Private", "Protect", "Restrict", "SystemCall", "Capability", "DevicePolicy", "Keyring", "Lock")
    service = {pair for pair in assignments(FOLDER / "halocline@.service") if pair[0].startswith(keys)}
    service.discard(("SystemCallFilter", "setpriority"))
    assert service <= set(assignments(UNIT))


@pytest.mark.parametrize("serial", [False, True], ids=["network", "serial port"])
def test_systemd_understands_it_and_finds_little_exposed(tmp_path: Path, serial: bool) -> None:
    unit = installed(tmp_path, serial=serial)
    verified = analyzed("verify", "--man=no", "--recursive-errors=no", str(unit))
    assert verified.stdout + verified.stderr == ""
    judged = analyzed("security", "--offline=true", "--no-pager", "--threshold=15", str(unit))
    if "unrecognized option" in judged.stderr:
        pytest.skip("this systemd-analyze can't judge units that are not loaded")
    print(judged.stdout.splitlines()[-1])
    assert judged.returncode == 0, judged.stdout
