"""Is the autopilot heard, by the right ears?"""

from autonomy.endpoints import parse_link
from autonomy.preflight.facts import Facts, Link
from autonomy.preflight.finding import Finding, failed, passed, warned

_NOISY_SHARE = 0.01
_LOOPBACK = ("127.", "localhost", "::1")

_OPENING = {
    "address already in use": "another program listens there: stop the service (systemctl stop 'halocline@*') or the "
    "ground station on this computer, or choose another port",
    "permission denied": "let this user open the device: the group dialout has it (sudo usermod -aG dialout USER)",
    "no such file": "plug the autopilot in, look for its device (ls -l /dev/serial/by-id), and set mavlink.endpoint",
    "connection refused": "nothing listens there: start the autopilot's side (mavlink-router, the simulator), or "
    "correct host and port in mavlink.endpoint",
}


def link_checks(facts: Facts) -> list[Finding]:
    """Link, heartbeat, noise, signing."""
    link, endpoint = facts.link, facts.configuration.mavlink.endpoint
    if link.trouble:
        said = link.trouble.lower()
        remedy = next(
            (remedy for word, remedy in _OPENING.items() if word in said), "correct mavlink.endpoint"
        )
        return [failed("link.open", link.trouble, remedy), *_signing(facts)]
    opened = passed("link.open", f"{endpoint}: {link.messages} messages in {link.seconds:.0f} s")
    found = [opened, _heard(facts), *_signing(facts)]
    if link.bad_frames > _NOISY_SHARE * max(1, link.messages):
        found.append(
            warned(
                "link.noise",
                f"{link.bad_frames} damaged packets beside {link.messages} sound ones",
                "look at cable, ground and baud rate; shorten the cable or lower the rate on both ends",
            )
        )
    return found


def _heard(facts: Facts) -> Finding:
    check, link, section = "link.vehicle", facts.link, facts.configuration.mavlink
    if facts.vehicle is None:
        return failed(check, *_silence(facts))
    state = facts.vehicle.state
    if len(link.systems) > 1 and section.system_id is None:
        return warned(
            check,
            f"several autopilots are heard (systems {_listed(link)}), and the first is taken: {state.system_id}",
            f"set mavlink.system_id to the one that is ours, such as {state.system_id}",
        )
    return passed(check, f"the autopilot of system {state.system_id} is heard, {state.heartbeats} heartbeats")


def _silence(facts: Facts) -> tuple[str, str]:
    """What is heard instead of our autopilot, and what to do."""
    link, section = facts.link, facts.configuration.mavlink
    if link.systems:
        return (
            f"system {section.system_id} is not heard, but {_listed(link)}",
            f"set mavlink.system_id to {_listed(link)}, or to null",
        )
    if link.refused:
        return (
            f"packets come in, and signing refuses them ({link.refused})",
            "use the same key on both ends: mavlink.signing.key_file and form here, the passphrase set up on the "
            "autopilot there (docs/security.md)",
        )
    if link.messages:
        return (
            f"{link.messages} messages, but no heartbeat of an autopilot",
            "let the router pass the autopilot's own messages on to this endpoint, not only those of ground stations",
        )
    if link.bytes_in:
        return (
            f"{link.bytes_in} bytes came in, and none of it is MAVLink",
            "set the same baud rate on both ends (SERIALn_BAUD) and SERIALn_PROTOCOL to 2",
        )
    kind = parse_link(section.endpoint).kind
    remedy = {
        "serial": "switch the autopilot on; cross TX and RX; set SERIALn_PROTOCOL to 2 and the same baud rate",
        "udpin": "let the autopilot or mavlink-router send to this computer and port; look at the firewall",
    }.get(kind, "switch the autopilot on, and look whether it answers at that address")
    return f"nothing came in for {link.seconds:.0f} s", remedy


def _signing(facts: Facts) -> list[Finding]:
    check, section, refused = "link.signing", facts.configuration.mavlink, facts.link.refused
    endpoint = parse_link(section.endpoint)
    if section.signing.key_file is not None:
        if refused and facts.vehicle is not None:
            return [
                warned(
                    check,
                    f"somebody on the link does not sign as the autopilot does ({refused})",
                    "give the ground station the same key, or find out who it is",
                )
            ]
        return [passed(check, "what is not signed is not believed")] if facts.vehicle is not None else []
    if endpoint.kind == "serial" or endpoint.host.startswith(_LOOPBACK):
        return [passed(check, "not signed, on a link within the boat")]
    return [
        warned(
            check,
            f"nothing is signed on {section.endpoint}: whoever is on that network can command the boat",
            "set mavlink.signing.key_file (docs/security.md), or listen on 127.0.0.1 behind a router of your own",
        )
    ]


def _listed(link: Link) -> str:
    return ", ".join(map(str, sorted(link.systems)))
