"""Is there room for what is recorded, and somebody ashore who listens?"""

from autonomy.preflight.facts import Facts, Folder
from autonomy.preflight.finding import Finding, failed, passed, warned

_LEAST_MB = 200.0
"""A day's journal of a boat with one probe, and two checkpoints."""


def computer_checks(facts: Facts) -> list[Finding]:
    """Disk and shore."""
    return [*(_folder(facts, each) for each in facts.folders), *_shore(facts)]


def _folder(facts: Facts, folder: Folder) -> Finding:
    check = f"disk.{folder.what}"
    if folder.trouble:
        return failed(
            check,
            f"{folder.path}: {folder.trouble}",
            f"correct {folder.what}.directory, or let the user that runs the service write there",
        )
    said = f"{folder.free_mb:.0f} MB free at {folder.path}"
    if folder.free_mb < _LEAST_MB:
        return failed(check, said, "make room: a full disk ends the recording, and restarts know nothing")
    limit_mb = facts.configuration.journal.total_mb
    if folder.what == "journal" and folder.free_mb < limit_mb:
        return warned(
            check,
            f"{said}, less than journal.total_mb ({limit_mb:g})",
            "make room, or lower journal.total_mb: the oldest runs would be given up early",
        )
    return passed(check, said)


def _shore(facts: Facts) -> list[Finding]:
    if not facts.routers:
        return [
            warned(
                "shore.router",
                "no router is named in shore.connect: nothing is published, and nobody ashore sees anything",
                "set shore.connect, such as [tcp/HOST:7447], if somebody shall",
            )
        ]
    found = [
        warned(
            "shore.router",
            f"{locator}: {trouble}",
            "see that zenohd runs there, that host, port and certificates are right, and no firewall is between; "
            "the survey goes on without",
        )
        if trouble
        else passed("shore.router", f"{locator} answers")
        for locator, trouble in facts.routers.items()
    ]
    doubts = [text.partition(": ")[2] for text in facts.doubts if text.startswith("shore.")]
    return found + [
        warned("shore.certificate", text, "make another one (docs/security.md)") for text in doubts
    ]
