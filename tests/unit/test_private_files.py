"""Files with secrets: who may read them, and what is said if too many may."""

import os
from pathlib import Path

import pytest

from autonomy.cli import main
from autonomy.config import ConfigurationError, load
from autonomy.config.private import MAXIMUM_BYTES, PrivateFileError, read_private
from autonomy.mavlink.signing import SigningKey

AREA = "survey:\n  area: [[0.0, 0.0], [0.0, 0.1], [0.1, 0.0]]\n"
PASSPHRASE = "correct horse battery staple"


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    file = tmp_path / "boat1.signing"
    file.write_text(PASSPHRASE + "\n")
    file.chmod(0o600)
    return file


def boat(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "boat.yaml"
    file.write_text(text + AREA)
    return file


@pytest.mark.parametrize("mode", [0o600, 0o400, 0o700])
def test_its_owner_may_read_it(secret: Path, mode: int) -> None:
    secret.chmod(mode)
    assert read_private(secret, {}).decode().strip() == PASSPHRASE


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644, 0o610, 0o602, 0o666])
def test_what_others_may_read_or_change_is_refused(secret: Path, mode: int) -> None:
    secret.chmod(mode)
    with pytest.raises(PrivateFileError, match=rf"others may read .*mode 0{mode:o}.*chmod 600"):
        read_private(secret, {})


def test_a_credential_of_systemd_is_private_whatever_its_mode_says(secret: Path, tmp_path: Path) -> None:
    """Root's, group root may read, and an access control list that lets the service in: so it looks like 0440."""
    secret.chmod(0o440)
    assert read_private(secret, {"CREDENTIALS_DIRECTORY": str(tmp_path)})
    for other in ("", str(tmp_path / "elsewhere"), str(tmp_path.parent)):
        with pytest.raises(PrivateFileError, match="others may read"):
            read_private(secret, {"CREDENTIALS_DIRECTORY": other})


def test_what_is_no_plain_file_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    for name in ("pipe", "."):
        with pytest.raises(PrivateFileError, match="is no plain file"):
            read_private(tmp_path / name, {})
    with pytest.raises(PrivateFileError, match="No such file"):
        read_private(tmp_path / "nothing", {})
    large = tmp_path / "large"
    large.write_bytes(bytes(MAXIMUM_BYTES + 1))
    large.chmod(0o600)
    with pytest.raises(PrivateFileError, match="too large"):
        read_private(large, {})


def test_a_public_key_file_is_told_at_its_place(
    secret: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    secret.chmod(0o644)
    file = boat(tmp_path, "mavlink:\n  signing:\n    key_file: boat1.signing\n")
    for verb in ("check-config", "show-config"):
        assert main([verb, str(file)]) == 78
        said = capsys.readouterr().err
        assert f"{file}:3:5: mavlink.signing.key_file: others may read" in said
        assert "chmod 600" in said
        assert PASSPHRASE not in said


def test_a_file_that_holds_no_key_is_told_at_its_place(
    secret: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = boat(tmp_path, "mavlink:\n  signing:\n    key_file: boat1.signing\n    form: key\n")
    assert main(["check-config", str(file)]) == 78
    said = capsys.readouterr().err
    assert f"{file}:3:5: mavlink.signing.key_file: " in said
    assert "64 hexadecimal digits" in said
    assert PASSPHRASE not in said


def test_show_config_shows_names_not_contents(
    secret: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = boat(tmp_path, "mavlink:\n  signing: {key_file: boat1.signing}\n")
    assert main(["show-config", str(file)]) == 0
    shown = capsys.readouterr().out
    assert str(secret) in shown
    assert PASSPHRASE not in shown
    key = SigningKey.from_file_content(PASSPHRASE.encode(), "passphrase")
    assert key._secret.hex() not in shown


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("{certificate: boat.pem}", "private_key: is missing while shore.tls.certificate is given"),
        ("{private_key: boat1.signing}", "certificate: is missing while shore.tls.private_key is given"),
        ("{root_ca: nowhere.pem}", "root_ca: no readable file"),
        ("{certificate: boat.pem, private_key: boat1.signing}", "certificate: is of no use: no locator"),
        ("{verify_name: 1}", "verify_name: must be true or false"),
        ("{certificate: boat.pem, private_key: boat.pem}", "private_key: others may read"),
    ],
)
def test_certificates_that_can_not_serve(secret: Path, tmp_path: Path, text: str, what: str) -> None:
    (tmp_path / "boat.pem").write_text("")
    (tmp_path / "boat.pem").chmod(0o644)
    with pytest.raises(ConfigurationError) as error:
        load(boat(tmp_path, f"shore:\n  connect: [tcp/localhost:7447]\n  tls: {text}\n"), {})
    assert f"shore.tls.{what}" in str(error.value)


def test_empty_sections_mean_their_defaults(tmp_path: Path) -> None:
    configuration = load(boat(tmp_path, "mavlink:\n  signing:\nshore:\n  tls:\n"), {})
    assert configuration.mavlink.signing.key_file is None
    assert configuration.shore.tls.verify_name
    assert configuration.model.hyperparameters is None
