"""What is doubted about a certificate before any router is asked."""

import subprocess
from pathlib import Path

import pytest

from autonomy.shell.certificate import doubt, identity


def make(folder: Path, name: str, *options: str) -> tuple[Path, Path]:
    certificate, key = folder / f"{name}.pem", folder / f"{name}.key"
    curve = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1")
    subject = ("-subj", f"/O=survey/CN={name}", "-keyout", str(key), "-out", str(certificate))
    lasting = () if "-days" in options or "-not_after" in options else ("-days", "365")
    words = ["openssl", "req", "-x509", *curve, *subject, *lasting, *options]
    if "-passout" not in options:
        words.append("-nodes")
    subprocess.run(words, check=True, capture_output=True)
    return certificate, key


def test_a_good_one_is_not_doubted(tmp_path: Path) -> None:
    files = make(tmp_path, "boat1", "-addext", "extendedKeyUsage=clientAuth")
    assert identity(*files).common_name == "boat1"
    assert doubt("boat1", *files) == ""
    assert doubt("boat1", None, None) == ""


def test_another_boats(tmp_path: Path) -> None:
    assert doubt("boat2", *make(tmp_path, "boat1")).startswith("the certificate is boat1's, not boat2's")


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (("-days", "3"), "the certificate expires on 20"),
        (("-addext", "extendedKeyUsage=serverAuth"), "unsuitable certificate purpose"),
        (("-passout", "pass:secret"), "must not have a passphrase"),
    ],
)
def test_one_that_routers_will_not_take(tmp_path: Path, options: tuple[str, ...], what: str) -> None:
    assert what in doubt("boat1", *make(tmp_path, "boat1", *options))


def test_files_that_are_none_or_do_not_belong_together(tmp_path: Path) -> None:
    certificate, key = make(tmp_path, "boat1")
    _, other = make(tmp_path, "boat2")
    assert "key values mismatch" in doubt("boat1", certificate, other)
    assert "No such file" in doubt("boat1", tmp_path / "none.pem", key)
    key.write_text("")
    assert doubt("boat1", certificate, key).startswith("routers will refuse the vehicle's certificate")
