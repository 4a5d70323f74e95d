"""The unit file: what systemd is told, and that systemd and the command line understand it."""

import argparse
import shlex
import shutil
import subprocess
from collections import defaultdict
from pathlib import Path

import pytest

from autonomy.commands import run as run_command
from autonomy.commands.configuration import EXIT_CONFIGURATION
from autonomy.config import load
from autonomy.config.private import PrivateFileError, read_private

UNIT = Path(__file__).parents[2] / "systemd" / "halocline@.service"
DROP_IN = UNIT.with_name("serial.conf")
SECRETS = {name: UNIT.with_name(f"{name}.conf") for name in ("signing", "tls", "commands")}


def settings(file: Path) -> dict[str, list[str]]:
    """Every assignment as SECTION.KEY: values in order."""
    found: defaultdict[str, list[str]] = defaultdict(list)
    section = ""
    for line in file.read_text().splitlines():
        if line.startswith("["):
            section = line.strip("[]")
        elif line and not line.startswith("#"):
            key, _, value = line.partition("=")
            found[f"{section}.{key}"].append(value)
    return dict(found)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("Unit.StartLimitIntervalSec", "0"),
        ("Service.Type", "notify"),
        ("Service.Restart", "always"),
        ("Service.RestartSec", "2"),
        ("Service.RestartPreventExitStatus", str(EXIT_CONFIGURATION)),
        ("Service.WatchdogSec", "10"),
        ("Service.OOMPolicy", "continue"),
        ("Service.DynamicUser", "yes"),
        ("Service.StateDirectory", "halocline/%i"),
        (
            "Service.ProcSubset",
            None,
        ),  # the machine's boot, by which times before and after a restart are compared
    ],
)
def test_an_unattended_boat_never_gives_up_but_over_its_configuration(key: str, value: str | None) -> None:
    assert settings(UNIT).get(key) == (None if value is None else [value])


def test_linear_algebra_stays_on_one_thread() -> None:
    environment = settings(UNIT)["Service.Environment"]
    assert {"OMP_NUM_THREADS=1", "OPENBLAS_NUM_THREADS=1", "MKL_NUM_THREADS=1"} <= set(environment)


def test_the_command_line_is_one_that_the_service_takes() -> None:
    (command,) = settings(UNIT)["Service.ExecStart"]
    program, verb, *words = shlex.split(command.replace("%i", "boat1"))
    parser = argparse.ArgumentParser()
    run_command.add_arguments(parser)
    assert (Path(program).name, verb) == ("autonomy", "run")
    assert parser.parse_args(words).config == "/etc/halocline/boat1.yaml"


@pytest.fixture
def analyze() -> str:
    """systemd's own judge of units."""
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip("systemd-analyze is not installed")
    return program


def installed(folder: Path, unit_text: str, drop_in_text: str = "") -> Path:
    """The unit with a drop-in in a folder; its program is one that exists here."""
    unit = folder / UNIT.name
    unit.write_text(unit_text.replace("/opt/halocline/bin/autonomy", shutil.which("true") or "/bin/true"))
    drop_in = folder / f"{UNIT.name}.d" / DROP_IN.name
    drop_in.parent.mkdir()
    drop_in.write_text(drop_in_text)
    return unit


def verdict(analyze: str, unit: Path) -> str:
    """What systemd has to say about the unit with its drop-in; empty if all is well."""
    verify = [analyze, "verify", "--man=no", "--recursive-errors=no", str(unit)]
    done = subprocess.run(verify, capture_output=True, text=True, timeout=60, check=False)
    return done.stdout + done.stderr


@pytest.mark.parametrize("drop_in", [DROP_IN, *SECRETS.values()], ids=lambda drop_in: drop_in.stem)
def test_systemd_understands_the_unit_and_its_drop_ins(analyze: str, tmp_path: Path, drop_in: Path) -> None:
    assert verdict(analyze, installed(tmp_path, UNIT.read_text(), drop_in.read_text())) == ""


@pytest.mark.parametrize(
    ("name", "source", "key"),
    [
        ("signing", "/etc/halocline/%i.signing", ("mavlink", "signing", "key_file")),
        ("tls", "/etc/halocline/%i.key", ("shore", "tls", "private_key")),
        ("commands", "/etc/halocline/%i.token", ("shore", "commands", "token_file")),
    ],
)
def test_secrets_come_as_credentials_and_the_configuration_finds_them(
    name: str, source: str, key: tuple[str, str, str], tmp_path: Path
) -> None:
    """What root alone can read, in a directory of systemd's that is named to the service in its environment."""
    found = settings(SECRETS[name])
    assert found["Service.LoadCredential"] == [f"{name}:{source}"]
    (assignment,) = found["Service.Environment"]
    variable, _, place = assignment.partition("=")
    assert place == f"%d/{name}"
    secret = tmp_path / name
    secret.write_text("a passphrase\n")
    secret.chmod(0o440)  # as systemd shows it where access control lists do the rest
    pem = tmp_path / "boat1.pem"
    pem.touch()
    file = tmp_path / "boat1.yaml"
    file.write_text(
        "survey: {area: [[33.4, -118.6], [33.4, -118.4], [33.6, -118.4]]}\n"
        "shore: {connect: [tls/shore.example.org:7447], tls: {root_ca: boat1.pem, certificate: boat1.pem}}\n"
        if name == "tls"
        else "survey: {area: [[33.4, -118.6], [33.4, -118.4], [33.6, -118.4]]}\n"
    )
    environment = {variable: place.replace("%d", str(tmp_path)), "CREDENTIALS_DIRECTORY": str(tmp_path)}
    configuration = load(file, environment)
    section = getattr(getattr(configuration, key[0]), key[1])
    assert getattr(section, key[2]) == secret
    assert read_private(secret, environment) == b"a passphrase\n"
    with pytest.raises(PrivateFileError, match="others may read"):
        read_private(secret, {})


def test_systemd_would_notice_a_misspelt_setting_in_either(analyze: str, tmp_path: Path) -> None:
    unit = UNIT.read_text().replace("WatchdogSec", "WatchdogSecs")
    drop_in = DROP_IN.read_text().replace("SupplementaryGroups", "SupplementaryGroup")
    said = verdict(analyze, installed(tmp_path, unit, drop_in))
    assert "WatchdogSecs" in said
    assert "'SupplementaryGroup'" in said


@pytest.mark.parametrize(
    "drop_in", [None, DROP_IN, *SECRETS.values()], ids=["network", "serial port", "signed", "tls", "commands"]
)
def test_little_is_exposed(analyze: str, tmp_path: Path, drop_in: Path | None) -> None:
    """At most 1.5 by systemd's measure, which gives 9.6 to a service that nothing is said about."""
    unit = installed(tmp_path, UNIT.read_text(), "" if drop_in is None else drop_in.read_text())
    words = [analyze, "security", "--offline=true", "--no-pager", "--threshold=15", str(unit)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    if "unrecognized option" in done.stderr:
        pytest.skip("this systemd-analyze can't judge units that are not loaded")
    print(done.stdout.splitlines()[-1])
    assert done.returncode == 0, done.stdout
