"""A month at sea under every fault that we can make: nothing ends it, and nothing grows.

HALOCLINE_MONTH_S: simulated seconds; without it fifty minutes, in which each fault strikes once. From a day on, memory
and time for a reading are held against those after the first hours, too: memory as the median over a day.

Memory is that of the service: jobs are done in a process of their own and free memory is given back, as there, and of
what was published only the newest is kept. Time is the thread's own CPU time, held against a `Twin`'s at the same
moments: other work on the machine slows both.
"""

import gc
import math
import os
import time
from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy import jobs
from autonomy.config import Configuration, JournalSection
from autonomy.core import Core
from autonomy.effects import Topic
from autonomy.events import DeadlineReached, Event, MessageReceived
from autonomy.mavlink.authority_table import Command
from autonomy.mavlink.rover import AUTO
from autonomy.memory import Memory
from autonomy.planning.passage import passage_of
from autonomy.planning.restrictions import Region, Restrictions, restricted
from autonomy.planning.survey import SurveyArea
from autonomy.shell import checkpoint
from autonomy.shell.allocator import GIVE_BACK_S, give_back, keep_compact
from autonomy.shell.checkpoint import Checkpoint
from autonomy.shell.journal import Journal, make_header
from sim.autopilot import Autopilot, Mode, Options
from sim.sensor import Sensor
from sim.vessel import Handling, Position, Vessel

from .conftest import FRAME, HARBOUR_M, MANNERS, SETTINGS, Sea, Voyage

MONTH_S = float(os.environ.get("HALOCLINE_MONTH_S", "3000"))
DAY_S = 86400.0
SPEEDUP = 10.0
HOUR = 3600
WINDOW = 1000
"""Readings whose time is taken together."""

DAY_WINDOWS = 80
"""So many of these are a day."""

KEPT, KEPT_LINES = 5, 40
"""Of each topic and of the traffic, and of the log: what a month of them takes is no memory of the service."""

TWIN_EVERY = 12
"""Events of the core for one of its twin's."""

GRACE_S = 0.2
JOURNAL = JournalSection(file_mb=1.0, total_mb=8.0)
BATCH_BYTES = 2**16
"""Written before the oldest file makes room for it."""

Tape = list[tuple[float, Event]]
"""Events, each with its time."""

WRAP_S = 2**32 / 1000.0
OVERRIDES: dict[str, dict[str, Any]] = {
    "sampling": {"spacing_m": 2.0},
    # Full after two hours, as a larger one is after a day.
    "model": {**SETTINGS["model"], "history_cells": 150},
    "exploration": {
        **SETTINGS["exploration"],
        "maximum_interval_s": 3600.0,
        "stall_s": 60.0,
        "give_up_s": 300.0,
    },
    "shore": {"model_period_s": 60.0, "health_period_s": 5.0},
}


class Timed:
    """A core whose CPU time is added up, without that of the journal's thread, which works meanwhile.

    Attributes:
        spent_s: since the costs were taken, for all events and for those that bring a reading.
        readings: so many of them came since the costs were taken.
        tape: where events are noted, if at all.
        twin: after each event it takes one of its own.
    """

    def __init__(self, core: Core) -> None:
        self.core = core
        self.spent_s = np.zeros(2)
        self.readings = 0
        self.tape: Tape | None = None
        self.twin: Twin | None = None

    def handle(self, now: float, event: Event) -> Any:
        if self.tape is not None and isinstance(event, MessageReceived | DeadlineReached):
            self.tape.append((now, event))
        begun = time.thread_time()
        effects = self.core.handle(now, event)
        spent_s, is_reading = time.thread_time() - begun, _is_reading(event)
        self.spent_s += (spent_s, spent_s * is_reading)
        self.readings += is_reading
        if self.twin is not None:
            self.twin.step()
        return effects

    def take_costs(self) -> Any:
        """Seconds for a reading since the last call: all events counted, and those that bring one."""
        costs = self.spent_s / max(1, self.readings)
        self.spent_s, self.readings = np.zeros(2), 0
        return costs

    def __getattr__(self, name: str) -> Any:
        return getattr(self.core, name)


class Twin:
    """The core as it was in the first hours, to which the same minutes happen again and again.

    What it takes for them tells how fast the machine is at the moment, with work of exactly the core's kind; its
    events lie scattered among the core's.
    """

    def __init__(self, new: Callable[[], Core], memory: Memory, tape: Tape) -> None:
        self._new = new
        self._memory = memory
        self._tape = tape
        self._passed = 0
        self.timed = Timed(new())
        self._begin()

    def _begin(self) -> None:
        """Be again as it was; what it was before holds itself, and must not lie about."""
        self.timed.core = self._new()
        self.timed.core.restore(deepcopy(self._memory))
        gc.collect()
        self._left = iter(self._tape)

    def step(self) -> None:
        """An event of the core's has passed."""
        self._passed += 1
        if self._passed % TWIN_EVERY:
            return
        event = next(self._left, None)
        if event is None:
            self._begin()
        else:
            self.timed.handle(*event)


def _is_reading(event: Event) -> bool:
    return isinstance(event, MessageReceived) and event.message.get_type() == "NAMED_VALUE_FLOAT"


class Month(Voyage):
    """A survey that forgets what it has said, or a month of it would fill the memory."""

    rng: np.random.Generator
    configuration: Configuration
    readings = 0
    heard = 0
    kept_s = 0.0
    loss = 0.0
    broken_jobs = False
    taken: float | None = None

    def prepare(self, rng: np.random.Generator, configuration: Configuration) -> None:
        self.rng = rng
        self.configuration = configuration
        self.late: list[tuple[float, str]] = []
        self.strandings: list[str] = []
        self.costs = array("d")
        self.resident = array("d")
        self.core = Timed(self.core)  # type: ignore[assignment]
        self.passes = lambda message: rng.random() >= self.loss
        work = self.run_job
        self.run_job = lambda *job: self._broken() if self.broken_jobs else work(*job)

    def _broken(self) -> Any:
        raise RuntimeError("killed after its deadline")

    def happened(self, event: Event) -> None:
        if isinstance(event, MessageReceived) and event.message.get_type() == "HEARTBEAT":
            beat = event.message
            if beat.get_srcSystem() == self.autopilot.system_id:
                armed = bool(beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                ours = beat.custom_mode == AUTO and armed and beat.system_status < mavlink.MAV_STATE_CRITICAL
                if ours or not self.core._helm.authority.survey_started:
                    self.taken = None
                elif self.taken is None:
                    self.taken = self.now
        super().happened(event)

    def _carry_out(self, effect: Any) -> None:
        before = len(self.sent)
        super()._carry_out(effect)
        is_before = self.core._helm.authority.command is Command.BEFORE_START
        for when, message in self.sent[before : before + 1]:
            kind = message.get_type()
            if (
                kind not in MANNERS
                and self.taken is not None
                and not is_before
                and when > self.taken + GRACE_S
            ):
                self.late.append((when, kind))

    def _take(self, packets: list[tuple[Any, bytes]]) -> None:
        super()._take([packet for packet in packets if self.loss == 0.0 or self.rng.random() >= self.loss])

    def sail(self, model_s: float) -> None:
        """For so many simulated seconds, in steps after which what was said is counted and forgotten."""
        left = model_s
        while left > 0.0:
            step_s = min(left, 60.0)
            self.advance(step_s / self.speedup)
            left -= step_s
            self.kept_s += step_s
            if self.kept_s >= GIVE_BACK_S:  # as the service does
                self.kept_s = 0.0
                give_back()
                self.resident.append(resident_bytes())
            told = sum(
                len(batch) if isinstance(batch, tuple) else 1 for batch in self.published[Topic.OBSERVATIONS]
            )
            self.readings += told
            self.published[Topic.OBSERVATIONS].clear()
            for kept in (*self.published.values(), self.sent):
                del kept[:-KEPT]
            del self.log[:-KEPT_LINES]
            self.autopilot.vessel.battery.used_wh = 0.0  # the sun shines
            self.journal.flush()  # in the service the journal keeps up
            if self.core.readings >= WINDOW:
                self.close_window()

    def close_window(self) -> None:
        """Note what a reading has cost since the last time, and what the twin's."""
        self.heard += self.core.readings
        costs = self.core.take_costs()
        if self.core.twin is not None:
            self.costs.extend((*costs, *self.core.twin.timed.take_costs()))

    def look_for_land(self, fault: str) -> None:
        """A boat on land stays there until it is another one; how it came there is told at the end."""
        if self.autopilot.vessel.aground:
            x, y = FRAME.to_local(*self.autopilot.vessel.position)
            self.strandings.append(f"{self.now:.0f}, {fault}: at {x:.0f}, {y:.0f}")
            print(self.strandings[-1], *self.log, sep="\n  ", flush=True)
            self.reboot(keep_mission=False)
            self.care()

    def make_twin(self, model_s: float = 120.0) -> None:
        """Of the core as it is, and of what happens to it within so many simulated seconds."""
        timed, memory, tape = self.core, self.core.checkpoint(), []
        timed.tape = tape
        self.sail(model_s)
        timed.tape = None
        timed.twin = Twin(lambda: Core(self.configuration, self.survey), memory, tape)
        self.close_window()
        del self.costs[:]

    def told(self) -> str:
        """How it goes, in a line."""
        taken = 1e6 * np.median(np.reshape(self.costs, (-1, 2, 2))[-DAY_WINDOWS:], axis=0)
        return (
            f"{self.heard} readings, {resident_bytes() / 1e6:.1f} MB resident, a reading takes "
            f"{taken[0].round()} us, the twin {taken[1].round()}"
        )

    def care(self) -> None:
        """The operator looks after the boat: it is brought under way again within some minutes."""
        for _ in range(60):
            self.arm()
            self.select(Mode.AUTO)
            self.sail(60.0)
            if self.core._situation.state.name == "EXPLORING":
                return
            if (
                self.core._helm.authority.command is Command.DISPLACED
                or "mission" in self.core._situation.reason
            ):
                self.select(Mode.HOLD)
                self.operate(mavlink.MAVLink_mission_clear_all_message(self.autopilot.system_id, 1))
                self.sail(150.0)
        raise AssertionError(
            f"not under way again: {self.core._situation.state}, {self.core._situation.reason}; {self.log[-5:]}"
        )

    def restart(self) -> None:
        """The service is killed, and another goes on from its checkpoint."""
        timed, away_s = self.core, float(self.rng.uniform(1.0, 30.0))
        memory = timed.checkpoint()
        new = Core(self.configuration, self.survey)
        new.restore(memory)
        self.linked = False
        self.advance(0.0)
        new.resume(self.now, away_s)
        if self.journal is not None:
            self.journal.resumed(self.now, away_s)
        timed.core = new  # type: ignore[attr-defined]
        self.restore_link()

    def reboot(self, *, keep_mission: bool = True) -> None:
        old = self.autopilot
        clock_s = float(self.rng.choice([0.0, WRAP_S - 100.0]))
        new = autopilot(self.rng, tuple(FRAME.to_local(*old.vessel.position).tolist()), boot_clock_s=clock_s)
        for seq in range(len(old.store) if keep_mission else 0):
            new.store.write(seq, old.store[seq])
        self.replace_autopilot(new)

    def checkpoint_bytes(self) -> int:
        kept = Checkpoint(1, {}, self.core.checkpoint(), self.now, 0.0, "", None)
        return len(checkpoint.encode(kept))


def autopilot(rng: np.random.Generator, at_m: Any = HARBOUR_M, **habits: Any) -> Autopilot:
    lat_deg, lon_deg = FRAME.to_geodetic(at_m).tolist()
    vessel = Vessel(
        Position(lat_deg, lon_deg), handling=Handling(acceleration_mps2=2.0, turn_rate_deg_s=30.0), land=Sea()
    )
    sensor = Sensor(Sea(), rng, "SALT", 1.0, noise_std=0.02)
    return Autopilot(vessel, sensor, Options(speed_mps=3.0, waypoint_radius_m=15.0, **habits))


Fault = Callable[[Month], Iterator[None]]


def no_position(run: Month) -> Iterator[None]:
    run.autopilot.navigator._ready_after_s = math.inf
    yield
    run.autopilot.navigator._ready_after_s = 0.0


def _instrument(run: Month, *faults: Any) -> Iterator[None]:
    assert run.autopilot.sensor is not None
    run.autopilot.sensor.faults = faults
    yield
    run.autopilot.sensor.faults = ()


def probe_stuck(run: Month) -> Iterator[None]:
    return _instrument(run, lambda time_s, value: 33.7)


def probe_without_a_number(run: Month) -> Iterator[None]:
    return _instrument(run, lambda time_s, value: math.nan)


def probe_out_of_range(run: Month) -> Iterator[None]:
    return _instrument(run, lambda time_s, value: 3.4e38)


def probe_spiking(run: Month) -> Iterator[None]:
    return _instrument(run, lambda time_s, value: value + 5.0 * (run.rng.random() < 0.1))


def probe_silent(run: Month) -> Iterator[None]:
    sensor, run.autopilot.sensor = run.autopilot.sensor, None
    yield
    assert sensor is not None
    sensor.taken = int(run.autopilot.vessel.time_s / sensor.interval_s)
    run.autopilot.sensor = sensor


def rebooted(run: Month) -> Iterator[None]:
    run.reboot(keep_mission=bool(run.rng.random() < 0.7))
    yield


def taken_by_the_operator(run: Month) -> Iterator[None]:
    # Not RTL: it is a straight line, and the island lies across it.
    run.select(Mode(run.rng.choice([Mode.HOLD, Mode.MANUAL, Mode.LOITER])))
    yield


def disarmed(run: Month) -> Iterator[None]:
    run.arm(armed=False)
    yield


def failsafe(run: Month) -> Iterator[None]:
    run.autopilot.reports.failsafe = True
    run.autopilot.parameters.set("FS_GCS_ENABLE", 1.0)
    yield
    run.autopilot.parameters.set("FS_GCS_ENABLE", 0.0)
    run.autopilot.reports.failsafe = False


def stopped_by_a_fence(run: Month) -> Iterator[None]:
    x, y = FRAME.to_local(*run.autopilot.vessel.position)
    run.fence((x - 150, y - 150), (x + 150, y - 150), (x + 150, y + 150), (x - 150, y + 150))
    yield
    run.autopilot.store.fence = []
    run.autopilot.parameters.set("FENCE_ENABLE", 0.0)
    # Whoever has read the fence meanwhile, after a reboot or a restart, hears that it is gone.
    run.autopilot._announce(run.autopilot.parameters.message("FENCE_ENABLE"))


def jobs_fail(run: Month) -> Iterator[None]:
    run.broken_jobs = True
    yield
    run.broken_jobs = False


def jobs_hang(run: Month) -> Iterator[None]:
    usual, run.job_s = run.job_s, 60.0
    yield
    run.job_s = usual


def mission_overwritten(run: Month) -> Iterator[None]:
    # Close by: nobody but us sees to it that a mission's way there is clear of the island.
    x, y = FRAME.to_local(*run.autopilot.vessel.position)
    run.upload_as_operator((x, y), (x + 30.0, y), (x, y + 30.0))
    yield


def mission_cleared(run: Month) -> Iterator[None]:
    run.operate(mavlink.MAVLink_mission_clear_all_message(run.autopilot.system_id, 1))
    yield


def link_cut(run: Month) -> Iterator[None]:
    run.cut_link()
    yield
    run.restore_link()


def link_silent(run: Month) -> Iterator[None]:
    run.linked = False
    yield
    run.linked = True


def link_storm(run: Month) -> Iterator[None]:
    run.loss = float(run.rng.uniform(0.1, 0.5))
    for _ in range(3):
        run.cut_link("storm")
        run.sail(float(run.rng.exponential(20.0)))
        run.restore_link()
        run.sail(float(run.rng.exponential(40.0)))
    yield
    run.loss = 0.0


def service_restarted(run: Month) -> Iterator[None]:
    run.restart()
    yield


FAULTS: tuple[Fault, ...] = (
    *(no_position, probe_stuck, probe_without_a_number, probe_out_of_range, probe_spiking, probe_silent),
    *(rebooted, taken_by_the_operator, disarmed, failsafe, stopped_by_a_fence, jobs_fail, jobs_hang),
    *(mission_overwritten, mission_cleared, link_cut, link_silent, link_storm, service_restarted),
)


@pytest.fixture
def worker() -> Iterator[ProcessPoolExecutor]:
    """A process of its own for the jobs."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        yield pool


def resident_bytes() -> int:
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def fill_caches(survey: SurveyArea) -> None:
    """The service keeps the passages of four waters: a fence or a stall makes another, so they are full some day."""
    for k in range(12):
        given_up = (Region(((300.0 + 100.0 * k, 300.0),), 100.0),)
        passage_of(restricted(survey, Restrictions(given_up=given_up)))


@pytest.fixture
def month(survey: SurveyArea, worker: ProcessPoolExecutor, tmp_path: Path) -> Iterator[Month]:
    settings: dict[str, Any] = {**SETTINGS, **OVERRIDES}
    configuration = Configuration.model_validate({**settings, "seed": 1})
    journal = Journal.open(
        tmp_path, JOURNAL, make_header(configuration, survey, now=1000.0, utc_s=1.7e9), utc_s=lambda: 1.7e9
    )
    keep_compact()
    fill_caches(survey)
    rng = np.random.default_rng(int(os.environ.get("HALOCLINE_SEED", "1")))
    run = Month(
        Core(configuration, survey),
        autopilot(rng),
        survey,
        job_s=0.5,
        run_job=lambda *job: worker.submit(jobs.run, *job).result(),
        speedup=SPEEDUP,
        journal=journal,
    )
    run.prepare(rng, configuration)
    yield run
    journal.close()


@pytest.mark.timeout(0 if MONTH_S >= DAY_S else 120)
def test_nothing_ends_it_and_nothing_grows(month: Month, tmp_path: Path) -> None:
    month.start_survey()
    month.sail(120.0)
    struck: Counter[str] = Counter()
    started, checkpoint_early, days = month.now, 0, 0
    while (month.now - started) * SPEEDUP < MONTH_S:
        for fault in month.rng.permutation(np.array(FAULTS, dtype=object)):
            lasts_s = month.rng.uniform(10.0, 60.0 if MONTH_S < DAY_S else 600.0)
            steps = fault(month)
            next(steps)
            month.sail(float(lasts_s))
            next(steps, None)
            month.care()
            struck[fault.__name__] += 1
            assert month.late == []
            month.look_for_land(fault.__name__)
            kept = sum(path.stat().st_size for path in tmp_path.iterdir())
            assert kept <= 1e6 * JOURNAL.total_mb + BATCH_BYTES
            if MONTH_S >= DAY_S:
                month.sail(float(month.rng.uniform(60.0, 600.0)))
        sailed_s = (month.now - started) * SPEEDUP
        if sailed_s >= (days + 1) * DAY_S:
            days = int(sailed_s / DAY_S)
            print(f"{sailed_s:.0f} s, {sum(struck.values())} faults: {month.told()}", flush=True)
        if not checkpoint_early and month.readings > HOUR:
            month.make_twin()
            month.sail(2.0 * WINDOW)
            checkpoint_early = month.checkpoint_bytes()
            del month.resident[:]
            print(f"\n{sailed_s:.0f} s, each fault has struck: {month.told()}", flush=True)
    health = month.health
    assert month.readings > 0.5 * MONTH_S
    assert health.samples > 0.2 * month.readings, "most of them taught, or this would prove little"
    assert health.replans > 2
    assert month.journal is not None
    assert month.journal.status.lost_records == 0
    assert set(struck) == {fault.__name__ for fault in FAULTS}
    if MONTH_S >= DAY_S:
        hold_against(month, checkpoint_early, sum(struck.values()))
    assert month.strandings == []


def hold_against(month: Month, checkpoint_early: int, struck: int) -> None:
    """The end against the time after the first hours."""
    costs = 1e6 * np.reshape(month.costs, (-1, 2, 2))
    share = max(10, len(costs) // 100)
    first, last = np.median(costs[:share], axis=0), np.median(costs[-share:], axis=0)
    ratios = last[0] / last[1] / (first[0] / first[1])
    # From hour to hour it goes up and down by one per cent: a plan is made, a twin begins anew.
    hours = min(24, len(month.resident) // 2)
    early, late = np.median(month.resident[:hours]), np.median(month.resident[-hours:])
    grown, kept = late / early - 1.0, month.checkpoint_bytes()
    print(
        f"\n{month.heard} readings heard, {month.readings} told, {struck} faults; "
        f"CPU time for a reading and for taking it in, us: at first {first[0].round()} (the twin {first[1].round()}), "
        f"at last {last[0].round()} (the twin {last[1].round()}): ratios {ratios.round(3)}; "
        f"memory over {hours} hours {early / 1e6:.1f} MB, grown by {100 * grown:.2f} %, "
        f"never more than {max(month.resident) / 1e6:.1f} MB; "
        f"a checkpoint {checkpoint_early / 1e3:.0f} kB, then {kept / 1e3:.0f} kB"
    )
    assert (ratios <= 1.1).all()
    assert grown < 0.02
    assert kept < 1.2 * checkpoint_early
