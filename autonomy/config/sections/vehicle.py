"""Sections about the vehicle: who it is, the link to it, and what we may do."""

from typing import Annotated, Literal

from pydantic import Field

from autonomy.config.sections.section import Section
from autonomy.config.types import ENDPOINT_FORMS, Endpoint, NonNegative, Positive, SecretPath


class VehicleSection(Section):
    """Who we are."""

    name: str = Field(
        default="boat1",
        pattern=r"^[A-Za-z0-9_-]{1,32}$",
        description="name of the vehicle; people ashore follow usv/NAME/… on zenoh",
        json_schema_extra={"allowed": "1 to 32 letters, digits, - and _"},
    )
    turn_rate_deg_s: float = Field(
        default=20.0,
        ge=1,
        le=360,
        allow_inf_nan=False,
        description="how quickly the vessel turns at its usual speed",
        json_schema_extra={"unit": "degrees per second"},
    )


class SigningSection(Section):
    """MAVLink 2 signing: with a key, nothing is accepted on the link that is not signed with it."""

    key_file: SecretPath | None = Field(
        default=None,
        description="file with the key that all on the link share; only its owner may read it; null: nothing is "
        "signed, and all is accepted",
    )
    form: Literal["passphrase", "key"] = Field(
        default="passphrase",
        description="what the file holds: a passphrase as it is typed into ground stations, whose SHA-256 is the key, "
        "or the key itself, 32 bytes or 64 hexadecimal digits",
    )
    link_id: int = Field(default=0, ge=0, le=255, description="link id in the packets that are sent")


class MavlinkSection(Section):
    """The link to the autopilot."""

    endpoint: Endpoint = Field(
        default="udpin:0.0.0.0:14551",
        description="where the autopilot is: udpin listens, udpout and tcp call, serial opens a device",
        json_schema_extra={"allowed": ENDPOINT_FORMS},
    )
    component_id: int = Field(
        default=191, ge=2, le=255, description="our MAVLink component; 191 is MAV_COMP_ID_ONBOARD_COMPUTER"
    )
    system_id: int | None = Field(
        default=None,
        ge=1,
        le=254,
        description="MAVLink system of the vehicle that is ours; null takes the first that is heard",
    )
    adopt: bool = Field(
        default=False,
        description="whether a mission on board that is not ours may be overwritten before the first AUTO",
    )
    position_rate_hz: Positive = Field(
        default=4.0, description="rate at which positions are asked of the autopilot"
    )
    acceptance_radius_m: Positive | None = Field(
        default=None,
        description="distance at which a waypoint counts as reached; sent with each waypoint; null: what the turn "
        "there asks for at the vessel's speed and vehicle.turn_rate_deg_s, from 2 m to half of what is kept from "
        "land and fence",
    )
    mission_items: int = Field(
        default=100,
        ge=5,
        le=10_000,
        description="waypoints sent at once; a longer route goes on board in stretches, without a stop between them",
    )
    link_timeout_s: Positive = Field(
        default=5.0, description="silence of the autopilot after which the link counts as lost"
    )
    signing: SigningSection = SigningSection()


class AuthoritySection(Section):
    """Who has the boat, and what we may do with it."""

    mode: Literal["missions", "full", "observe"] = Field(
        default="missions",
        description="missions: upload missions and make them current, in AUTO; full: also select AUTO, arm, and send "
        "the boat home; observe: send nothing but heartbeats and words to the operator, only learn and publish",
    )
    start: Literal["by_itself", "on_command"] = Field(
        default="by_itself",
        description="how the boat is started in mode full: by itself, as soon as it can be, or not before `start` from "
        "ashore",
    )
    resume: Literal["when_auto_again", "never"] = Field(
        default="when_auto_again",
        description="how a boat that was taken from us (mode, failsafe, disarmed, another mission) is given back: by "
        "selecting AUTO, or not before the service is set up anew",
    )
    return_mode: Literal["rtl", "smart_rtl"] = Field(
        default="rtl", description="the autopilot's mode that brings the boat home (mode full)"
    )
    return_battery: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] | None = Field(
        default=0.25,
        description="charge with which the boat is sent home, once for each charge (mode full); null: never",
        json_schema_extra={"unit": "of the full charge"},
    )
    fence_margin_m: NonNegative = Field(
        default=20.0, description="distance kept from the autopilot's fence, inside it"
    )
