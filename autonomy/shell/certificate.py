"""What our own certificate says, and whether it can serve: a handshake with ourselves, in memory."""

import ssl
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_EXPIRES_SOON_S = 30 * 86400.0


@dataclass(frozen=True)
class Identity:
    """What a certificate says of its owner: the common name, and when it expires, UTC seconds."""

    common_name: str
    expires_utc_s: float


def identity(certificate: Path, private_key: Path) -> Identity:
    """The identity that a client shows with these files, in PEM form.

    Raises:
        ValueError: they can't be read, do not belong together, have expired, or are not for clients; says which.
    """
    try:
        return _shown(certificate, private_key)
    except ssl.SSLCertVerificationError as error:
        raise ValueError(f"{str(certificate)!a}: {error.verify_message}") from None
    except ssl.SSLError as error:
        what = str(getattr(error, "reason", None) or error.args[-1]).replace("_", " ").lower()
        raise ValueError(f"{str(certificate)!a} with {str(private_key)!a}: {what}") from None
    except OSError as error:
        raise ValueError(f"{str(certificate)!a} with {str(private_key)!a}: {error.strerror}") from None


def doubt(vehicle: str, certificate: Path | None, private_key: Path | None) -> str:
    """What may make routers refuse this vehicle's certificate, in words; empty if nothing seems to."""
    if certificate is None or private_key is None:
        return ""
    try:
        shown = identity(certificate, private_key)
    except ValueError as error:
        return f"routers will refuse the vehicle's certificate: {error}"
    if shown.common_name != vehicle:
        return (
            f"the certificate is {shown.common_name}'s, not {vehicle}'s: routers that go by names refuse it"
        )
    if shown.expires_utc_s - time.time() < _EXPIRES_SOON_S:
        when = time.strftime("%Y-%m-%d", time.gmtime(shown.expires_utc_s))
        return f"the certificate expires on {when}"
    return ""


def _shown(certificate: Path, private_key: Path) -> Identity:
    client, server = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT), ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
    for context in (client, server):
        # A key with a passphrase would ask for it at the terminal.
        context.load_cert_chain(certificate, private_key, password=_refuse)
    server.verify_mode = ssl.CERT_REQUIRED
    server.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    server.load_verify_locations(certificate)
    up, down = ssl.MemoryBIO(), ssl.MemoryBIO()
    ours = client.wrap_bio(down, up, server_side=False)
    theirs = server.wrap_bio(up, down, server_side=True)
    # Three rounds are enough for any handshake.
    if not any(_advance(ours) & _advance(theirs) for _ in range(10)):
        raise ssl.SSLError("the handshake with ourselves does not end")
    said: Any = theirs.getpeercert()
    names = [value for part in said["subject"] for name, value in part if name == "commonName"]
    return Identity(str(names[0]) if names else "", ssl.cert_time_to_seconds(str(said["notAfter"])))


def _advance(side: ssl.SSLObject) -> bool:
    """Take the handshake as far as it goes; whether it is done."""
    try:
        side.do_handshake()
    except ssl.SSLWantReadError:
        return False
    return True


def _refuse() -> str:
    raise ssl.SSLError("the key must not have a passphrase: nobody is there to type it")
