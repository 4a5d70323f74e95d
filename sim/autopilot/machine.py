"""The autopilot as one machine without sockets: messages and time in, messages out."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.autopilot import missions
from sim.autopilot.commands import Command, Commands
from sim.autopilot.missions import MissionStore
from sim.autopilot.modes import Mode
from sim.autopilot.navigation import Navigator
from sim.autopilot.parameters import Parameters
from sim.autopilot.reports import Reports
from sim.autopilot.streams import Streams
from sim.autopilot.transfer import MissionService
from sim.sensor import Sensor
from sim.vessel import Position, Vessel

COMPONENT_ID = 1
LONGEST_STEP_S = 1.0
_SHORTEST_STEP_S = 1e-6


class All(Enum):
    """The address of a message that every client gets, or every one that has said something."""

    ALL = "all"
    HEARD = "heard"


ALL = All.ALL
HEARD = All.HEARD
Client = Hashable
Outgoing = tuple[Client | All, Any]


@dataclass(frozen=True)
class Options:
    """Habits of the simulated autopilot; by default it is as ArduPilot Rover is.

    Attributes:
        ready_after_s: simulated seconds from power-on until the estimator knows where it is.
        arming_checks: refuses to be armed before that.
        boot_clock_s: what its clock shows at power-on; it wraps after 2^32 ms.
        reboots_after_s: simulated seconds from power-on until it starts again, once; None: only when it is told to.
        request_int: asks for mission items with MISSION_REQUEST_INT, not with the legacy message.
        ends_on_wrong_item: an item out of turn ends an upload; ArduPilot answers 13 and goes on.
        atomic_uploads: a mission is replaced when its upload is complete; ArduPilot's dies leaving a hybrid.
        restarts_on_upload: a new mission is sailed from its first item; ArduPilot keeps the index it had, and a
            complete mission stays complete.
        deaf_to_set_current: so many of the first DO_SET_MISSION_CURRENT are accepted and not acted on.
        tells_fence: fence and rally points can be downloaded.
        probe_component: the instrument is a component of its own, with another clock; its readings are routed to
            clients only that have said something. None: the autopilot sends them.
    """

    system_id: int = 1
    speed_mps: float = 2.0
    waypoint_radius_m: float = 2.0
    start_utc_s: float = 1_700_000_000.0
    ready_after_s: float = 0.0
    arming_checks: bool = False
    request_int: bool = False
    boot_clock_s: float = 0.0
    reboots_after_s: float | None = None
    ends_on_wrong_item: bool = False
    atomic_uploads: bool = False
    restarts_on_upload: bool = False
    deaf_to_set_current: int = 0
    tells_fence: bool = True
    probe_component: int | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.system_id <= 254:
            raise ValueError(
                f"the system id must be 1 to 254 (255 is the ground station's), got {self.system_id}"
            )
        if not 0.0 < self.speed_mps <= 100.0:
            raise ValueError(f"the speed must be above 0 and at most 100 m/s, got {self.speed_mps}")
        if not self.waypoint_radius_m > 0.0:
            raise ValueError(f"the waypoint radius must be positive, got {self.waypoint_radius_m} m")


class Autopilot:
    """ArduPilot Rover with a boat's frame, as far as a ground station or a companion can tell.

    `now` is protocol time in seconds (heartbeats, streams, mission timeouts); `dt_sim_s` is simulated time.
    A driver that wants a SITL's behaviour passes simulated time as `now` too.
    """

    def __init__(
        self,
        vessel: Vessel,
        sensor: Sensor | None = None,
        options: Options | None = None,
        home: Position | None = None,
    ) -> None:
        options = Options() if options is None else options
        self.vessel = vessel
        self.sensor = sensor
        self.system_id = options.system_id
        self.options = options
        self.parameters = Parameters(
            CRUISE_SPEED=options.speed_mps,
            WP_RADIUS=options.waypoint_radius_m,
            MAV_SYSID=options.system_id,
            SYSID_THISMAV=options.system_id,
        )
        self.store = MissionStore(vessel.position if home is None else home)
        self._out: list[Outgoing] = []
        self._reboot_due_s = options.reboots_after_s
        self._handlers: dict[str, Callable[[float, Any, Client], None]] = {
            "HEARTBEAT": self._on_heartbeat,
            "COMMAND_LONG": self._on_command,
            "COMMAND_INT": self._on_command,
            "SET_MODE": self._on_set_mode,
            "MISSION_SET_CURRENT": self._on_set_current,
            "PARAM_REQUEST_LIST": self._on_param_list,
            "PARAM_REQUEST_READ": self._on_param_read,
            "PARAM_SET": self._on_param_set,
            "REQUEST_DATA_STREAM": self._on_data_stream,
            "TIMESYNC": self._on_timesync,
            "PING": self._on_ping,
            "SET_POSITION_TARGET_GLOBAL_INT": self._on_position_target,
        }
        self._boot(options.boot_clock_s)

    def _boot(self, clock_s: float) -> None:
        """Everything that is not stored begins anew; what the clock shows now, in seconds, is given."""
        options, booted_s = self.options, self.vessel.time_s
        self.navigator = Navigator(
            self.vessel,
            self.parameters,
            self.store,
            self._announce,
            ready_after_s=booted_s + options.ready_after_s,
        )
        self.reports = Reports(self.navigator, options.start_utc_s, options.system_id, clock_s - booted_s)
        self._streams = Streams()
        self._commands = Commands(
            self.navigator, self.reports, self._streams, options.arming_checks, options.deaf_to_set_current
        )
        self._missions = MissionService(
            self.store,
            lambda: self.navigator.mode is Mode.AUTO,
            options.request_int,
            self._mission_stored,
            ends_on_wrong_item=options.ends_on_wrong_item,
            atomic=options.atomic_uploads,
            stores=missions.STORED_TYPES if options.tells_fence else (missions.MISSION,),
        )
        self._gcs_heard: float | None = None
        self._progress_told: tuple[int, int] | None = None

    def reboot(self, now: float) -> None:
        """Start again where the boat is: disarmed, in MANUAL, the clock at zero, streams as nobody has asked for.

        Parameters and missions are stored, and stay; whoever was served is served on.
        """
        clients = self._streams.clients
        self._reboot_due_s = None
        self._boot(0.0)
        for client in clients:
            self._streams.join(now, client)

    @property
    def time_s(self) -> float:
        """Simulated seconds since boot."""
        return self.vessel.time_s

    def join(self, now: float, client: Client) -> None:
        """Serve a client that has not spoken yet: it gets the default streams from now on."""
        self._streams.join(now, client)

    def leave(self, client: Client) -> None:
        """Forget a client that is gone."""
        self._streams.leave(client)
        self._missions.forget(client)

    def handle(self, now: float, message: Any, client: Client) -> list[Outgoing]:
        """Take one message from a client; messages for others and echoes of ourselves change nothing."""
        self.join(now, client)
        if self.concerns_us(message):
            handler = self._handlers.get(message.get_type())
            if handler is not None:
                handler(now, message, client)
            else:
                self._out += self._missions.handle(now, message, client)
            self._tell_progress()
        return self._drain()

    def advance(self, now: float, dt_sim_s: float) -> list[Outgoing]:
        """Let `dt_sim_s` simulated seconds pass, then run the timers that are due at `now`.

        Steps are at most a second long and end exactly where a reading of the sensor is due. Every reading
        goes to every client right behind a GLOBAL_POSITION_INT of the same time_boot_ms.
        """
        end_s = self.vessel.time_s + dt_sim_s
        while end_s - self.vessel.time_s > _SHORTEST_STEP_S:
            step_s = min(LONGEST_STEP_S, end_s - self.vessel.time_s)
            if self.sensor is not None:
                step_s = min(step_s, max(_SHORTEST_STEP_S, self.sensor.next_time_s - self.vessel.time_s))
            self.navigator.advance(step_s)
            self._read_sensor()
        if self._reboot_due_s is not None and self.vessel.time_s >= self._reboot_due_s:
            self.reboot(now)
        self._tell_progress()
        self._check_gcs(now)
        self._out += [reply for reply in self._missions.poll(now) if reply[0] is not None]
        self._send_streams(now)
        return self._drain()

    def concerns_us(self, message: Any) -> bool:
        """Whether a message is for this autopilot: to it by name or to everybody, and not from itself."""
        if (message.get_srcSystem(), message.get_srcComponent()) == (self.system_id, COMPONENT_ID):
            return False
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self.system_id) and component in (0, COMPONENT_ID)

    def _announce(self, message: Any) -> None:
        self._out.append((ALL, message))

    def _drain(self) -> list[Outgoing]:
        out, self._out = self._out, []
        return out

    def _read_sensor(self) -> None:
        sensor, vessel = self.sensor, self.vessel
        if sensor is None:
            return
        while sensor.next_time_s <= vessel.time_s + 0.5 * _SHORTEST_STEP_S:
            value = sensor.read(vessel.position, vessel.time_s)
            if sensor.says is not None:
                sensor.says(value)
                continue
            self._announce(self.reports.global_position())
            reading = self.reports.sensor_value(sensor.name, value)
            self._out.append((ALL if self.options.probe_component is None else HEARD, reading))

    def _tell_progress(self) -> None:
        """MISSION_CURRENT at once when the item or the state changes; otherwise it is a stream at 1 Hz."""
        progress = (self.navigator.current, int(self.navigator.mission_state))
        if progress != self._progress_told:
            if self._progress_told is not None:
                self._announce(self.reports.mission_current())
            self._progress_told = progress

    def _send_streams(self, now: float) -> None:
        built: dict[int, Any] = {}
        for client, message_id in self._streams.due(now):
            if message_id not in built:
                built[message_id] = self.reports.build(message_id)
            self._out.append((client, built[message_id]))

    def _check_gcs(self, now: float) -> None:
        """The ground station's failsafe: HOLD and CRITICAL; the mode stays when the link is back."""
        if self.parameters["FS_GCS_ENABLE"] == 0.0 or self._gcs_heard is None:
            self.reports.failsafe = False
            return
        lost = now - self._gcs_heard > self.parameters["FS_GCS_TIMEOUT"]
        if lost and not self.reports.failsafe and self.navigator.armed:
            self.reports.failsafe = True
            self.navigator.say(mav.MAV_SEVERITY_WARNING, "GCS Failsafe")
            action = self.parameters["FS_ACTION"]
            if action == 1.0:
                self.navigator.set_mode(Mode.RTL)
            elif action != 0.0:
                self.navigator.set_mode(Mode.HOLD)
        elif not lost and self.reports.failsafe:
            self.reports.failsafe = False
            self.navigator.say(mav.MAV_SEVERITY_NOTICE, "GCS Failsafe Cleared")

    def _mission_stored(self, mission_type: int) -> None:
        totals = {
            missions.MISSION: ("MIS_TOTAL", len(self.store)),
            missions.FENCE: ("FENCE_TOTAL", len(self.store.fence)),
            missions.RALLY: ("RALLY_TOTAL", len(self.store.rally)),
        }
        self.parameters.set(*totals[mission_type])
        if mission_type == missions.MISSION:
            self.navigator.mission_stored(restart=self.options.restarts_on_upload)
            self.navigator.say(mav.MAV_SEVERITY_INFO, f"Mission: {self.store.total} WP")

    def _on_heartbeat(self, now: float, message: Any, client: Client) -> None:
        if message.get_srcSystem() == int(self.parameters["MAV_GCS_SYSID"]):
            self._gcs_heard = now

    def _on_command(self, now: float, message: Any, client: Client) -> None:
        if message.command == mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN and message.param1 == 1.0:
            self._acknowledge(message, client, message.command, mav.MAV_RESULT_ACCEPTED)
            self.reboot(now)
            return
        answer = self._commands.run(Command.from_message(now, client, message))
        self._acknowledge(message, client, message.command, answer.result)
        self._out += [(client, each) for each in answer.messages]

    def _on_set_mode(self, now: float, message: Any, client: Client) -> None:
        if message.base_mode & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            result = self._commands.enter_number(message.custom_mode).result
        else:
            result = mav.MAV_RESULT_DENIED
        self._acknowledge(message, client, mav.MAVLINK_MSG_ID_SET_MODE, result)

    def _acknowledge(self, message: Any, client: Client, command: int, result: int) -> None:
        ack = mav.MAVLink_command_ack_message(
            command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
        )
        self._out.append((client, ack))

    def _on_set_current(self, now: float, message: Any, client: Client) -> None:
        if self.navigator.set_current(message.seq):
            self._out.append((client, self.reports.mission_current()))

    def _on_param_list(self, now: float, message: Any, client: Client) -> None:
        self._out += [(client, each) for each in self.parameters.messages()]

    def _on_param_read(self, now: float, message: Any, client: Client) -> None:
        name = self.parameters.name_of(message.param_id, message.param_index)
        if name is not None:
            self._out.append((client, self.parameters.message(name)))

    def _on_param_set(self, now: float, message: Any, client: Client) -> None:
        name, value = message.param_id, message.param_value
        if name not in self.parameters:
            return
        finite = value - value == 0.0
        if finite and name not in ("MIS_TOTAL", "FENCE_TOTAL", "RALLY_TOTAL", "MAV_SYSID", "SYSID_THISMAV"):
            self.parameters.set(name, value)
        self._announce(self.parameters.message(name))

    def _on_data_stream(self, now: float, message: Any, client: Client) -> None:
        rate_hz = message.req_message_rate if message.start_stop else 0
        self._streams.request_group(now, client, message.req_stream_id, rate_hz)

    def _on_timesync(self, now: float, message: Any, client: Client) -> None:
        if message.tc1 == 0:
            self._out.append((client, self.reports.timesync(message)))

    def _on_ping(self, now: float, message: Any, client: Client) -> None:
        if message.target_system == 0:
            to = (message.get_srcSystem(), message.get_srcComponent())
            self._out.append((client, mav.MAVLink_ping_message(message.time_usec, message.seq, *to)))

    def _on_position_target(self, now: float, message: Any, client: Client) -> None:
        position = Position(message.lat_int * 1e-7, message.lon_int * 1e-7)
        ignores_position = message.type_mask & 3
        if self.navigator.mode is Mode.GUIDED and not ignores_position and abs(position.lat_deg) <= 90.0:
            self.navigator.guide_to(position)
