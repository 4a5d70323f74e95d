"""The operator in a demo: a ground station that arms the boat and selects AUTO once a mission is on board."""

import asyncio
import time
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.codec import Codec
from autonomy.mavlink.rover import AUTO
from autonomy.mavlink.signing import Signing, SigningKey
from autonomy.mavlink.telemetry import Telemetry
from autonomy.mavlink.vehicle import VehicleState
from autonomy.shell.transport import Transport
from autonomy.shell.transports import open_transport

_GROUND_STATION_ID = 255
_TURN_S = 0.5
_PATIENCE_TURNS = 10


class Operator:
    """Connects to the vessel beside the service, starts the survey, and notes the track; signs if given a key."""

    def __init__(self, endpoint: str, key: SigningKey | None = None) -> None:
        self._endpoint = endpoint
        signing = None if key is None else Signing(key, time.time)
        self._codec = Codec(_GROUND_STATION_ID, mavlink.MAV_COMP_ID_MISSIONPLANNER, signing)
        self._telemetry = Telemetry("none")
        self._transport: Transport | None = None
        self.track_deg: list[tuple[float, float]] = []
        self._told_whole = False
        self._waypoints: int | None = None
        self._turns = 0
        self.started = False
        """Whether the boat has been in AUTO, armed."""

    @property
    def state(self) -> VehicleState | None:
        """The vehicle as the operator sees it."""
        return self._telemetry.state

    async def run(self) -> None:
        """Keep the link; start the survey when it can be started. Ends by cancellation."""
        self._transport = open_transport(self._endpoint, self._received, lambda: None, lambda _reason: None)
        try:
            while True:
                self._send(
                    mavlink.MAVLink_heartbeat_message(
                        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
                    )
                )
                if not self.started:
                    self._start_survey()
                await asyncio.sleep(_TURN_S)
        finally:
            await self._transport.close()

    def _received(self, data: bytes, peer: Any) -> None:
        now = asyncio.get_running_loop().time()
        for message in self._codec.decode(data, peer):
            self._telemetry.handle(now, message)
            if message.get_type() == "STATUSTEXT" and message.text.startswith("Mission: "):
                self._told_whole = True
            state = self.state
            if (
                message.get_type() == "GLOBAL_POSITION_INT"
                and state is not None
                and state.lat_deg is not None
            ):
                assert state.lon_deg is not None
                self.track_deg.append((state.lat_deg, state.lon_deg))

    def _start_survey(self) -> None:
        state = self.state
        if state is None or not self._is_whole(state):
            return
        if state.armed and state.mode == AUTO:
            self.started = True
        elif not state.armed:
            self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        else:
            self._command(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, AUTO)

    def _is_whole(self, state: VehicleState) -> bool:
        """Whether a mission is on board, and not one that is still coming in.

        The autopilot says so at an upload's end; who came after that sees that it does not grow any more.
        """
        if state.mission_total != self._waypoints:
            self._waypoints, self._turns = state.mission_total, 0
        self._turns += 1
        return bool(self._waypoints) and (self._told_whole or self._turns > _PATIENCE_TURNS)

    def _command(self, command: int, *parameters: float) -> None:
        assert self.state is not None
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        target = (self.state.system_id, self.state.component_id)
        self._send(mavlink.MAVLink_command_long_message(*target, command, 0, *padded))

    def _send(self, message: Any) -> None:
        if self._transport is not None:
            self._transport.send(self._codec.encode(message))
