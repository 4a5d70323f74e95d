"""Sections about what leaves the core: to the shore, to the disk, to the log."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from autonomy.config.sections.section import Conflict, Section
from autonomy.config.types import LOCATOR_FORMS, FilePath, FolderPath, Locator, Positive, SecretPath
from autonomy.endpoints import is_encrypted

_PEM = "the name of a file in PEM form, or null"


class TlsSection(Section):
    """Certificates for the routers that are dialled by tls/… or quic/…; other locators have no use for them."""

    root_ca: FilePath | None = Field(
        default=None,
        description="certificate of the authority that the routers' certificates come from; null: those that browsers "
        "trust",
        json_schema_extra={"allowed": _PEM},
    )
    certificate: FilePath | None = Field(
        default=None,
        description="certificate that the vessel shows to the routers; its common name is what their access control "
        "goes by",
        json_schema_extra={"allowed": _PEM},
    )
    private_key: SecretPath | None = Field(
        default=None,
        description="private key of that certificate; only its owner may read it",
        json_schema_extra={"allowed": _PEM},
    )
    verify_name: bool = Field(
        default=True, description="whether a router's certificate must be for the host that is dialled"
    )

    def conflicts(self) -> Iterator[Conflict]:
        """A certificate is of no use without its key, nor a key without its certificate."""
        if (self.certificate is None) != (self.private_key is None):
            missing, given = ("certificate", "private_key")
            if self.private_key is None:
                missing, given = given, missing
            what = f"is missing while shore.tls.{given} is given"
            yield Conflict((missing, given), what, "both certificate and private_key, or neither")


class CommandsSection(Section):
    """Commands from ashore (`autonomy ctl`): off, unless one of these says who may give them."""

    token_file: SecretPath | None = Field(
        default=None,
        description="file with the secret that commands must be sealed with, at least 16 bytes; only its owner may "
        "read it; null: commands need no seal",
    )
    trust_router: bool = Field(
        default=False,
        description="whether the routers' access control lets commands of operators through and no others (see "
        "config/router.json5), so that they need no seal",
    )

    @property
    def accepted(self) -> bool:
        """Whether anybody may command."""
        return self.token_file is not None or self.trust_router


ByteRate = Annotated[float, Field(ge=50, le=10_000_000, allow_inf_nan=False)]


class ShoreSection(Section):
    """zenoh: the routers ashore that the vessel dials, and how often it publishes."""

    connect: Annotated[list[Locator], Field(strict=False)] = Field(
        default=[],
        description="routers ashore that the vessel dials, for ever; none: nothing is published",
        json_schema_extra={"allowed": f"a list of {LOCATOR_FORMS}"},
    )
    model_period_s: Positive = Field(
        default=2.0, description="shortest time between two snapshots of the model"
    )
    health_period_s: Positive = Field(default=1.0, description="time between two reports of health")
    backlog: int = Field(
        default=604_800,
        ge=1,
        le=10_000_000,
        description="observations kept for whoever ashore lacks them, in 40 bytes each; then the oldest are dropped",
    )
    precision: Literal["lossless", "16 bit", "12 bit", "8 bit"] = Field(
        default="16 bit", description="precision of the models that are published"
    )
    rate_limit_bytes_per_s: ByteRate | None = Field(
        default=None,
        description="what a thin link can take: models are coarser and everything is rarer then, the newest "
        "first; null: there is no limit",
        json_schema_extra={"unit": "bytes/s"},
    )
    commands: CommandsSection = CommandsSection()
    tls: TlsSection = TlsSection()

    def conflicts(self) -> Iterator[Conflict]:
        """Certificates protect nothing on a way that does not use them, and access control goes by certificates."""
        if self.commands.trust_router:
            key = "commands.trust_router"
            if self.tls.certificate is None:
                what = "is of no use without shore.tls.certificate: a router that knows nobody lets everybody through"
                yield Conflict((key, "tls.certificate"), what, "shore.tls with certificate and private_key")
            elif not all(map(is_encrypted, self.connect)):
                what = "is of no use: not every locator in shore.connect begins with tls/ or quic/"
                yield Conflict((key, "connect"), what, "locators such as tls/shore.example.org:7447")
        if self.tls.certificate is not None and not any(map(is_encrypted, self.connect)):
            what = "is of no use: no locator in shore.connect begins with tls/ or quic/"
            yield Conflict(
                ("tls.certificate", "connect"), what, "locators such as tls/shore.example.org:7447"
            )


class JournalSection(Section):
    """The recording of a run: everything that happened, for restarts and replay, and the MAVLink stream."""

    enabled: bool = Field(default=True, description="whether runs are recorded")
    directory: FolderPath | None = Field(
        default=None,
        description="where to; null: journal in systemd's state directory, or else in "
        "~/.local/state/halocline/NAME, with vehicle.name for NAME",
        json_schema_extra={"allowed": "the name of a folder, made if need be, or null"},
    )
    file_mb: float = Field(
        default=32.0,
        ge=0.1,
        le=1000,
        allow_inf_nan=False,
        description="size at which a new file is begun",
        json_schema_extra={"unit": "MB"},
    )
    file_age_s: Positive = Field(default=86400.0, description="age at which a new file is begun")
    total_mb: float = Field(
        default=4000.0,
        ge=1,
        le=1_000_000,
        allow_inf_nan=False,
        description="size of all files together above which the oldest are removed",
        json_schema_extra={"unit": "MB"},
    )
    sync_s: float = Field(
        default=1.0,
        ge=0,
        le=1,
        allow_inf_nan=False,
        description="longest time until what has happened is safe from a power cut",
    )

    def conflicts(self) -> Iterator[Conflict]:
        """The newest file must not push itself out."""
        if self.total_mb < 2 * self.file_mb:
            what = f"must be at least twice journal.file_mb ({self.file_mb:g}) (got {self.total_mb:g})"
            yield Conflict(("total_mb", "file_mb"), what, "journal.total_mb >= 2 * journal.file_mb")


class CheckpointSection(Section):
    """What is kept of the core's knowledge, so that a restarted service goes on where it was."""

    enabled: bool = Field(default=True, description="whether a restarted service knows what it knew before")
    directory: FolderPath | None = Field(
        default=None,
        description="where checkpoints are kept; null: checkpoint in systemd's state directory, or else in "
        "~/.local/state/halocline/NAME, with vehicle.name for NAME",
        json_schema_extra={"allowed": "the name of a folder, made if need be, or null"},
    )
    period_s: float = Field(
        default=60.0,
        ge=1,
        le=3600,
        allow_inf_nan=False,
        description="time between two checkpoints; what happened since the last one is replayed from the journal",
    )


class LoggingSection(Section):
    """What goes into the log."""

    level: Literal["debug", "info", "warning", "error"] = Field(
        default="info", description="lines below this severity are left out"
    )
