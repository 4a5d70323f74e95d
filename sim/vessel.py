"""The simulated vessel: how a boat moves over the ellipsoid, with limits, a current, and a shore to run onto.

Everything here is deterministic and knows no clock: `dt_s` comes in as an argument. Positions are advanced
by small steps on the local radii of curvature of WGS84, which over legs of tens of kilometres agrees with
the geodesic to centimetres as long as steps are at most a second or so.
"""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

WGS84_A_M = 6378137.0
WGS84_E2 = 6.69437999014e-3
_LOOKAHEAD_S = 5.0
_LOOKAHEAD_MIN_M = 6.0
_STEEPEST_CRAB = 0.985  # sine of about 80 degrees: a current stronger than the boat cannot be crabbed away


class ScalarField(Protocol):
    """The truth that the sensor measures; see `sim.field`."""

    def value(self, lat_deg: Any, lon_deg: Any, time_s: Any) -> Any:
        """Values at positions and at seconds since the start; NaN on land."""
        ...

    def is_land(self, lat_deg: Any, lon_deg: Any) -> Any:
        """Whether positions are on land."""
        ...


class CurrentField(Protocol):
    """A current that varies in space and time."""

    def current(self, lat_deg: float, lon_deg: float, time_s: float) -> tuple[float, float]:
        """Velocity of the water, east and north, in m/s."""
        ...


@dataclass(frozen=True)
class UniformCurrent:
    """The same current everywhere and always."""

    east_mps: float = 0.0
    north_mps: float = 0.0

    def current(self, lat_deg: float, lon_deg: float, time_s: float) -> tuple[float, float]:
        """Velocity of the water, east and north, in m/s."""
        return self.east_mps, self.north_mps


@dataclass(frozen=True)
class SummedCurrent:
    """Several currents on top of one another."""

    parts: tuple[CurrentField, ...]

    def current(self, lat_deg: float, lon_deg: float, time_s: float) -> tuple[float, float]:
        """Velocity of the water, east and north, in m/s."""
        each = [part.current(lat_deg, lon_deg, time_s) for part in self.parts]
        return math.fsum(east for east, _ in each), math.fsum(north for _, north in each)


class Position(NamedTuple):
    """A geodetic position in degrees."""

    lat_deg: float
    lon_deg: float

    def offset_to(self, other: "Position") -> tuple[float, float]:
        """East and north metres from here to `other` (radii taken half-way; centimetres over 15 km)."""
        meridian_m, parallel_m = radii_m(0.5 * (self.lat_deg + other.lat_deg))
        dlon = (other.lon_deg - self.lon_deg + 180.0) % 360.0 - 180.0
        return math.radians(dlon) * parallel_m, math.radians(other.lat_deg - self.lat_deg) * meridian_m

    def distance_to(self, other: "Position") -> float:
        """Metres from here to `other`."""
        return math.hypot(*self.offset_to(other))

    def moved(self, east_m: float, north_m: float) -> "Position":
        """The position a short way (metres to some hundreds of metres) from here."""
        meridian_m, _ = radii_m(self.lat_deg)
        lat = self.lat_deg + math.degrees(north_m / meridian_m)
        _, parallel_m = radii_m(0.5 * (self.lat_deg + lat))
        return Position(lat, self.lon_deg + math.degrees(east_m / parallel_m))


def radii_m(lat_deg: float) -> tuple[float, float]:
    """Metres per radian of latitude and of longitude on WGS84 at a latitude."""
    sine = math.sin(math.radians(lat_deg))
    w2 = 1.0 - WGS84_E2 * sine * sine
    normal_m = WGS84_A_M / math.sqrt(w2)
    return normal_m * (1.0 - WGS84_E2) / w2, normal_m * math.cos(math.radians(lat_deg))


@dataclass(frozen=True)
class Leg:
    """A straight line to be followed from `origin` to `destination`."""

    origin: Position
    destination: Position


@dataclass(frozen=True)
class Handling:
    """What the hull and its propeller can do."""

    acceleration_mps2: float = 0.5
    turn_rate_deg_s: float = 20.0
    top_speed_mps: float = 100.0

    def __post_init__(self) -> None:
        if not min(self.acceleration_mps2, self.turn_rate_deg_s, self.top_speed_mps) > 0.0:
            raise ValueError(f"acceleration, turn rate and top speed must be positive, got {self}")


@dataclass(frozen=True)
class UnsteadyCurrent:
    """A current that swings about a mean: plane waves, so that it is known at any place and time.

    Make it with `UnsteadyCurrent.draw`. Attributes: the mean, and of each wave its amplitude (east and north), its wave
    number (radians per metre to the east and to the north), its rate (radians per second) and its phase.
    """

    mean_mps: tuple[float, float]
    waves: tuple[tuple[float, float, float, float, float, float], ...]

    @classmethod
    def draw(
        cls, mean_mps: tuple[float, float], deviation_mps: float, rng: np.random.Generator, count: int = 8
    ) -> "UnsteadyCurrent":
        """Swings of a standard deviation (of each component), over 1 to 6 hours and 5 to 30 km."""
        amplitude = rng.normal(0.0, deviation_mps * math.sqrt(2.0 / count), (count, 2))
        direction = rng.uniform(0.0, 2.0 * math.pi, count)
        number = 2.0 * math.pi / rng.uniform(5e3, 30e3, count)
        rate = 2.0 * math.pi / rng.uniform(3600.0, 6.0 * 3600.0, count)
        phase = rng.uniform(0.0, 2.0 * math.pi, count)
        columns = (*amplitude.T, number * np.cos(direction), number * np.sin(direction), rate, phase)
        return cls(mean_mps, tuple(map(tuple, np.column_stack(columns).tolist())))

    def current(self, lat_deg: float, lon_deg: float, time_s: float) -> tuple[float, float]:
        """Velocity of the water, east and north, in m/s."""
        east_m = math.radians(lon_deg) * WGS84_A_M * math.cos(math.radians(lat_deg))
        north_m = math.radians(lat_deg) * WGS84_A_M
        swings = [
            (math.cos(kx * east_m + ky * north_m + rate * time_s + phase), east, north)
            for east, north, kx, ky, rate, phase in self.waves
        ]
        return (
            self.mean_mps[0] + math.fsum(swing * east for swing, east, _ in swings),
            self.mean_mps[1] + math.fsum(swing * north for swing, _, north in swings),
        )


@dataclass
class Battery:
    """A battery drained by the hotel load and by propulsion, which grows with the cube of speed.

    `noise` is the standard deviation of a factor that waves and wind put on the power, relative to it; it comes and
    goes over `noise_s`, drawn from `rng` (an Ornstein-Uhlenbeck process).
    """

    capacity_wh: float = 5000.0
    hotel_w: float = 25.0
    propulsion_w_per_m3s3: float = 15.0
    used_wh: float = 0.0
    power_w: float = 25.0
    drawn_c: float = 0.0
    noise: float = 0.0
    noise_s: float = 600.0
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    _swing: float = 0.0

    def drain(self, speed_mps: float, dt_s: float) -> None:
        """Spend the energy of `dt_s` seconds at a speed through the water."""
        self.power_w = (self.hotel_w + self.propulsion_w_per_m3s3 * abs(speed_mps) ** 3) * self._factor(dt_s)
        self.drawn_c += self.current_a * dt_s
        self.used_wh = min(self.capacity_wh, self.used_wh + self.power_w * dt_s / 3600.0)

    def _factor(self, dt_s: float) -> float:
        if self.noise == 0.0:
            return 1.0
        kept = math.exp(-dt_s / self.noise_s)
        self._swing = kept * self._swing + math.sqrt(1.0 - kept * kept) * float(self.rng.standard_normal())
        return math.exp(self.noise * self._swing - 0.5 * self.noise**2)

    @property
    def remaining(self) -> float:
        """Share of the capacity that is left, 0 to 1."""
        return 1.0 - self.used_wh / self.capacity_wh

    @property
    def voltage_v(self) -> float:
        """Terminal voltage of a four-cell pack, linear in what is left."""
        return 13.2 + 3.6 * self.remaining

    @property
    def current_a(self) -> float:
        """Current drawn now."""
        return self.power_w / self.voltage_v


@dataclass
class Vessel:
    """Position, heading and speed of a boat, moved one short step at a time.

    `heading_deg` is true, clockwise from north; `speed_mps` is through the water. A boat that touches land
    (`land`) stops where the water ended, sets `aground` and stays.
    """

    position: Position
    heading_deg: float = 0.0
    speed_mps: float = 0.0
    handling: Handling = field(default_factory=Handling)
    current: CurrentField = field(default_factory=UniformCurrent)
    land: ScalarField | None = None
    battery: Battery = field(default_factory=Battery)
    time_s: float = 0.0
    aground: bool = False
    moored: bool = True
    turn_rate_deg_s: float = 0.0
    velocity_mps: tuple[float, float] = (0.0, 0.0)
    previous: Position = field(init=False)
    distance_sailed_m: float = 0.0

    def __post_init__(self) -> None:
        self.previous = self.position

    def follow(self, leg: Leg, speed_mps: float, dt_s: float) -> None:
        """Sail one step along a leg: back to its line, along it, and no further than its end."""
        self.moored = False
        course = _course_along(self.position, leg, max(_LOOKAHEAD_MIN_M, _LOOKAHEAD_S * self.speed_mps))
        heading = self._crab(course, max(speed_mps, 0.1))
        error = math.radians(angle_between_deg(self.heading_deg, heading))
        # A boat slows down for a sharp turn; it also keeps the swing clear of what lies beside the line.
        self._step(heading, speed_mps * max(0.2, math.cos(error)), dt_s)

    def keep_station(self, point: Position, radius_m: float, speed_mps: float, dt_s: float) -> None:
        """Stay within `radius_m` of a point: drift inside, return from outside."""
        distance = self.position.distance_to(point)
        if distance <= radius_m:
            self.drift(dt_s)
        else:
            self.follow(Leg(self.position, point), min(speed_mps, max(0.3, 0.5 * distance)), dt_s)

    def lie(self, dt_s: float) -> None:
        """One step disarmed: on the mooring at first, adrift after the boat has left it."""
        self._step(self.heading_deg, 0.0, dt_s)

    def drift(self, dt_s: float) -> None:
        """One step with the propeller stopped."""
        self.moored = False
        self._step(self.heading_deg, 0.0, dt_s)

    def stop_at(self, position: Position) -> None:
        """The last step is taken back to where it began, and the boat has no way on."""
        self.position = self.previous = position
        self.speed_mps, self.velocity_mps = 0.0, (0.0, 0.0)

    def passed(self, leg: Leg, radius_m: float) -> bool:
        """Whether the last step came within `radius_m` of the leg's end, or crossed its finish line.

        Both are ArduPilot's tests; the closest point of the step counts, so a long step does not jump over
        a small circle.
        """
        bx, by = leg.destination.offset_to(self.position)
        ax, ay = leg.destination.offset_to(self.previous)
        dx, dy = bx - ax, by - ay
        length2 = dx * dx + dy * dy
        t = 0.0 if length2 == 0.0 else min(1.0, max(0.0, -(ax * dx + ay * dy) / length2))
        if math.hypot(ax + t * dx, ay + t * dy) <= radius_m:
            return True
        ox, oy = leg.origin.offset_to(leg.destination)
        return (ox != 0.0 or oy != 0.0) and bx * ox + by * oy >= 0.0

    @property
    def ground_speed_mps(self) -> float:
        """Speed over the ground."""
        return math.hypot(*self.velocity_mps)

    @property
    def course_deg(self) -> float:
        """Course over the ground, true."""
        return math.degrees(math.atan2(*self.velocity_mps)) % 360.0

    def _crab(self, course_deg: float, speed_mps: float) -> float:
        """The heading that makes good a course in the current."""
        east, north = self.current.current(*self.position, self.time_s)
        course = math.radians(course_deg)
        set_to_starboard = east * math.cos(course) - north * math.sin(course)
        sine = min(_STEEPEST_CRAB, max(-_STEEPEST_CRAB, -set_to_starboard / speed_mps))
        return (course_deg + math.degrees(math.asin(sine))) % 360.0

    def _step(self, heading_deg: float, speed_mps: float, dt_s: float) -> None:
        if not 0.0 < dt_s <= 1.0:
            raise ValueError(f"a step must be within (0, 1] s, got {dt_s}")
        self.previous = self.position
        most = self.handling.turn_rate_deg_s * dt_s
        turn = min(most, max(-most, angle_between_deg(self.heading_deg, heading_deg)))
        speed_mps = min(self.handling.top_speed_mps, max(0.0, speed_mps))
        change = self.handling.acceleration_mps2 * dt_s
        self.speed_mps += min(change, max(-change, speed_mps - self.speed_mps))
        self.turn_rate_deg_s = turn / dt_s
        self.heading_deg = (self.heading_deg + turn) % 360.0
        self.battery.drain(self.speed_mps, dt_s)
        self._move(dt_s)
        self.time_s += dt_s

    def _move(self, dt_s: float) -> None:
        if self.moored:
            return
        east, north = self.current.current(*self.position, self.time_s)
        heading = math.radians(self.heading_deg)
        east += self.speed_mps * math.sin(heading)
        north += self.speed_mps * math.cos(heading)
        there = self.position.moved(east * dt_s, north * dt_s)
        if not self.aground and self.land is not None and bool(self.land.is_land(*there)):
            self.aground = True
        if self.aground:
            self.speed_mps, self.velocity_mps = 0.0, (0.0, 0.0)
            return
        self.position = there
        self.velocity_mps = (east, north)
        self.distance_sailed_m += math.hypot(east, north) * dt_s


def angle_between_deg(from_deg: float, to_deg: float) -> float:
    """The turn from one direction to another, in [-180, 180)."""
    return (to_deg - from_deg + 180.0) % 360.0 - 180.0


def _course_along(position: Position, leg: Leg, lookahead_m: float) -> float:
    """Course over the ground towards the point of the leg that lies `lookahead_m` ahead (line of sight)."""
    to_x, to_y = position.offset_to(leg.destination)
    leg_x, leg_y = leg.origin.offset_to(leg.destination)
    length = math.hypot(leg_x, leg_y)
    if length < 1.0:
        return math.degrees(math.atan2(to_x, to_y)) % 360.0
    ux, uy = leg_x / length, leg_y / length
    beyond = max(0.0, to_x * ux + to_y * uy - lookahead_m)
    return math.degrees(math.atan2(to_x - beyond * ux, to_y - beyond * uy)) % 360.0
