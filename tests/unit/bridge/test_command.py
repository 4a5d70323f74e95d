"""`autonomy bridge` at the dock: what it prints, and how it ends."""

import stat
from pathlib import Path

import pytest

from autonomy.bridge.configuration import load_bridge
from autonomy.bridge.start import open_raw_log, open_signing
from autonomy.cli import main
from autonomy.config import ConfigurationError

CONFIGURATION = """\
instrument: {name: probe, endpoint: "serial:/dev/null/probe:9600", warm_up_s: 60}
line: {columns: 2}
values:
  SALT: {field: 1, scale: 0.001, delay_s: 8, response_s: 2}
  TEMP: {field: 2, response_s: 2, response: sharpen}
mavlink: {endpoint: "udpout:127.0.0.1:14560"}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "bridge.yaml"
    path.write_text(CONFIGURATION)
    return path


def test_check_shows_what_lines_say_even_of_those_that_would_be_withheld(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = tmp_path / "captured.txt"
    lines.write_bytes(b"33512, 17.5\r\ngarb\x07ge\r\n33513, x\r\n")
    assert main(["bridge", str(file), "--check", str(lines)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "33512, 17.5",
        "  SALT = 33.512, of water taken in 10 s before",
        "  TEMP = 17.5, to be sharpened; of water taken in 0 s before",
        "  withheld: warming up",
        "'garb\\x07ge'",
        "  can't be read: not 2 columns",
        "33513, x",
        "  can't be read: a field is no number",
        "",
        "1 of 3 lines can be read",
    ]


def test_if_nothing_can_be_read_the_exit_code_says_so(file: Path, tmp_path: Path) -> None:
    lines = tmp_path / "captured.txt"
    lines.write_text("1;2\n")
    assert main(["bridge", str(file), "--check", str(lines)]) == 1


def test_a_port_that_can_not_be_opened_is_named(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bridge", str(file), "--check", "--seconds", "0.2"]) == 1
    said = capsys.readouterr().err
    assert "/dev/null/probe" in said
    assert "nothing came" in said


def test_a_file_that_is_not_there_is_a_mistake_of_usage(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bridge", str(file), "--replay", "nowhere.txt"]) == 2
    assert "nowhere.txt" in capsys.readouterr().err


def test_a_wrong_configuration_ends_with_78(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file.write_text(CONFIGURATION.replace("columns: 2", "columns: two"))
    assert main(["bridge", str(file), "--check"]) == 78
    assert f"{file}:2:8: line.columns: must be a whole number" in capsys.readouterr().err


def signed(file: Path, mode: int) -> None:
    key = file.with_name("probe.signing")
    key.write_text("a passphrase\n")
    key.chmod(mode)
    file.write_text(CONFIGURATION.replace('14560"}', '14560", signing: {key_file: probe.signing}}'))


def test_a_signed_link_is_signed_and_its_timestamps_are_kept(file: Path, tmp_path: Path) -> None:
    signed(file, stat.S_IRUSR)
    link = open_signing(load_bridge(file), {"STATE_DIRECTORY": str(tmp_path / "state")})
    assert link is not None
    link.close()
    assert (tmp_path / "state" / "signing.json").exists()


def test_a_key_that_others_may_read_is_refused_with_its_place(file: Path) -> None:
    signed(file, 0o644)
    with pytest.raises(
        ConfigurationError, match=r"bridge.yaml:6:57: mavlink.signing.key_file: others may read"
    ):
        load_bridge(file)


def test_where_nothing_can_be_recorded_the_bridge_goes_on_without(
    file: Path, caplog: pytest.LogCaptureFixture
) -> None:
    configuration = load_bridge(file)
    assert open_raw_log(configuration, {"STATE_DIRECTORY": "/dev/null/state"}, "0.1") is None
    assert open_raw_log(configuration, {}, "0.1") is None
    assert [each.message.startswith("lines are not recorded") for each in caplog.records] == [True, True]
