"""The demo: vessel, service and shore as three processes over UDP and zenoh on loopback; we play the operator.

This process only watches: it follows the vessel's belief over zenoh like anybody ashore and holds it against the truth.
"""

import asyncio
import os
import socket
import sys
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import tqdm

from autonomy.geometry import FloatArray
from autonomy.shore.subscriber import Subscriber, Update
from autonomy.wire import HealthNotice, ModelSnapshot, PlanNotice
from sim.demo_scene import READINGS_PER_SAMPLE, Scene, make_scene, open_sea, write_files
from sim.operator import Operator
from sim.plots import demo_figure

VEHICLE = "demo"
_START_S = 90.0
_STOP_S = 10.0
_TURN_S = 0.25


class DemoError(RuntimeError):
    """The demo can't go on; the text says why, for a person."""


@dataclass(frozen=True)
class DemoOptions:
    """What the command line says; `seconds` of wall-clock time are sailed at `speedup`."""

    folder: Path
    spec: str = "synthetic-patch"
    variable: str | None = None
    seconds: float = 120.0
    speedup: float = 500.0
    seed: int = 0
    ground_station: str | None = None


@dataclass
class Course:
    """How the belief grew: one entry for each model that came ashore."""

    samples: list[int] = field(default_factory=list)
    rmse: list[float] = field(default_factory=list)
    plans: list[PlanNotice] = field(default_factory=list)
    model: ModelSnapshot | None = None
    health: HealthNotice | None = None


@dataclass(frozen=True)
class Outcome:
    """What came of it; `field_std` is the truth's standard deviation over the water at the end."""

    km: float
    samples: int
    basis_size: int
    plans: int
    rmse: float
    field_std: float
    legs: int
    legs_over_land: int
    picture: Path

    def __str__(self) -> str:
        return (
            f"{self.km:.1f} km, {self.samples} samples, {self.basis_size} basis vectors, {self.plans} plans: "
            f"RMSE {self.rmse:.4f} = {self.rmse / self.field_std:.0%} of the field's standard deviation; "
            f"{self.legs_over_land} of {self.legs} legs over land"
        )


async def run_demo(options: DemoOptions) -> Outcome:
    """Run all of it.

    Raises:
        FieldError: the field can't be used.
        DemoError: a process ended before its time, or nothing was learned.
    """
    ports = dict(zip(("vehicle", "operator", "shore"), free_ports(3), strict=True))
    sea = open_sea(options.spec, options.variable)
    print(sea.info.description)
    file, configuration, survey = write_files(sea, options.folder, ports)
    scene = make_scene(sea, survey, configuration.sampling.spacing_m, options.seconds * options.speedup)
    print(
        f"{survey.area_m2 / 1e6:.0f} km2 of water; a sample every {scene.spacing_m:.0f} m or more, "
        f"{scene.speed_mps:.1f} m/s, {options.speedup:g} times as fast as life; files in {options.folder}"
    )
    course = Course()
    async with AsyncExitStack() as stack:
        shore_at = f"tcp/127.0.0.1:{ports['shore']}"
        processes = [
            await _started(stack, options.folder, name, words)
            for name, words in (
                ("shore", _shore_words(shore_at, options.folder)),
                ("vessel", _vessel_words(options, scene, ports)),
                ("service", ("autonomy", "run", "--config", str(file))),
            )
        ]
        watcher = stack.enter_context(Subscriber(VEHICLE, connect=[shore_at], on_update=_noted(course)))
        operator = Operator(f"tcp:127.0.0.1:{ports['operator']}")
        sailing = asyncio.create_task(operator.run())
        stack.callback(sailing.cancel)
        await _follow(options, scene, course, operator, processes, sailing)
        course.model = watcher.latest(VEHICLE).model or course.model
    return _conclude(options, scene, course, operator)


def free_ports(count: int) -> list[int]:
    """Ports of the loopback interface that were free a moment ago, for UDP and TCP alike."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [int(each.getsockname()[1]) for each in sockets]
    finally:
        for each in sockets:
            each.close()


def _shore_words(shore_at: str, folder: Path) -> Sequence[str]:
    return ("autonomy", "shore", "watch", VEHICLE, "--listen", shore_at, "--png", str(folder / "live.png"))


def _vessel_words(options: DemoOptions, scene: Scene, ports: dict[str, int]) -> Sequence[str]:
    lat_deg, lon_deg = scene.start_deg
    words = ["sim", "vessel", "--field", options.spec, "--shrink-to-m", "15000", "--seed", str(options.seed)]
    words += [] if options.variable is None else ["--variable", options.variable]
    words += [f"--start={lat_deg:.7f},{lon_deg:.7f}", "--speedup", f"{options.speedup:g}"]
    words += [
        "--speed-mps",
        f"{scene.speed_mps:.3f}",
        "--noise",
        f"{scene.noise:.6g}",
        "--current=0.15,-0.10",
    ]
    words += ["--sample-interval-s", f"{scene.spacing_m / scene.speed_mps / READINGS_PER_SAMPLE:.3f}"]
    words += [
        "--listen",
        f"udpout:127.0.0.1:{ports['vehicle']}",
        "--listen",
        f"tcp:127.0.0.1:{ports['operator']}",
    ]
    return words + (
        [] if options.ground_station is None else ["--listen", f"udpout:{options.ground_station}"]
    )


async def _started(
    stack: AsyncExitStack, folder: Path, name: str, words: Sequence[str]
) -> tuple[str, asyncio.subprocess.Process]:
    """A process of its own, its output in a file; it is ended with the stack."""
    log = stack.enter_context((folder / f"{name}.log").open("wb"))
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", *words), stdout=log, stderr=log, env={**os.environ, **threads}
    )
    stack.push_async_callback(_ended, process)
    return name, process


async def _ended(process: asyncio.subprocess.Process) -> None:
    """End a process: kindly at first, but whatever happens it is gone afterwards."""
    if process.returncode is not None:
        return
    process.terminate()
    try:
        async with asyncio.timeout(_STOP_S):
            await process.wait()
    except TimeoutError:
        print(f"process {process.pid} doesn't stop when asked and is killed", file=sys.stderr)
    finally:
        # Also when a second signal cancels the wait for the first one's effect.
        if process.returncode is None:
            process.kill()
            await asyncio.shield(process.wait())


def _noted(course: Course) -> Callable[[Update], None]:
    def note(update: Update) -> None:
        if isinstance(update.value, ModelSnapshot):
            course.model = update.value
        elif isinstance(update.value, HealthNotice):
            course.health = update.value
        elif isinstance(update.value, PlanNotice):
            course.plans.append(update.value)

    return note


async def _follow(
    options: DemoOptions,
    scene: Scene,
    course: Course,
    operator: Operator,
    processes: list[tuple[str, asyncio.subprocess.Process]],
    sailing: "asyncio.Task[None]",
) -> None:
    """Wait for the start, then show the progress until the time is over."""
    loop = asyncio.get_running_loop()
    begun: float | None = None
    deadline = loop.time() + _START_S
    judged = 0
    with tqdm.tqdm(
        total=options.seconds, unit="s", bar_format="{l_bar}{bar}| {n:.0f}/{total:.0f} s {postfix}"
    ) as bar:
        while begun is None or loop.time() - begun < options.seconds:
            await asyncio.sleep(_TURN_S)
            for name, process in processes:
                if process.returncode is not None:
                    raise DemoError(
                        f"the {name} process ended early; its last words: {_tail(options.folder, name)}"
                    )
            if sailing.done():
                sailing.result()
            if begun is None:
                if operator.started:
                    begun = loop.time()
                elif loop.time() > deadline:
                    raise DemoError(
                        f"no mission came on board within {_START_S:.0f} s; see {options.folder}/service.log"
                    )
                continue
            bar.update(min(loop.time() - begun, options.seconds) - bar.n)
            model = course.model
            # Until offset and scale are known there is no belief to judge.
            if model is not None and model.sequence != judged and len(model.model.basis):
                judged = model.sequence
                rmse, std = scene.judge(model.model, model.model_time_s)
                course.samples.append(model.samples)
                course.rmse.append(rmse)
                bar.set_postfix_str(_progress(course, rmse / std))


def _progress(course: Course, share: float) -> str:
    model, health = course.model, course.health
    assert model is not None
    km = 0.0 if health is None or health.distance_m is None else health.distance_m / 1000.0
    return (
        f"{km:.1f} km, {model.samples} samples, {len(model.model.basis)} basis, rho {model.rho:.2f}, "
        f"{model.replans} plans, RMSE {share:.0%} of sd"
    )


def _tail(folder: Path, name: str) -> str:
    lines = (folder / f"{name}.log").read_text(errors="replace").strip().splitlines()
    return " / ".join(lines[-3:]) or "none"


def _conclude(options: DemoOptions, scene: Scene, course: Course, operator: Operator) -> Outcome:
    model = course.model
    if model is None or not course.samples:
        raise DemoError(f"nothing was learned; see {options.folder}/service.log")
    rmse, std = scene.judge(model.model, model.model_time_s)
    legs = [leg for plan in course.plans for leg in _legs([plan.start_deg, *plan.route_deg])]
    legs += _legs(operator.track_deg)
    picture = options.folder / "demo.png"
    outcome = Outcome(
        km=0.0 if course.health is None else (course.health.distance_m or 0.0) / 1000.0,
        samples=model.samples,
        basis_size=len(model.model.basis),
        plans=len(course.plans),
        rmse=rmse,
        field_std=std,
        legs=len(legs),
        legs_over_land=sum(scene.crosses_land(a, b) for a, b in legs),
        picture=picture,
    )
    belief = model.model.predict_grid(scene.x_axis_m, scene.y_axis_m)
    to_local = scene.survey.frame.to_local
    demo_figure(
        picture,
        scene.x_axis_m,
        scene.y_axis_m,
        scene.truth(model.model_time_s),
        belief.mean,
        np.sqrt(belief.variance),
        to_local(*np.transpose(operator.track_deg)),
        model.model.basis,
        np.vstack([_spots(plan, scene) for plan in course.plans]),
        course.samples,
        course.rmse,
        std,
        scene.field.info.long_name,
        scene.field.info.units,
        str(outcome),
    )
    return outcome


def _legs(positions: Sequence[tuple[float, float]]) -> list[tuple[FloatArray, FloatArray]]:
    points = np.asarray(positions, dtype=float).reshape(-1, 2)
    return list(pairwise(points))


def _spots(plan: PlanNotice, scene: Scene) -> FloatArray:
    route = np.asarray(plan.route_deg, dtype=float).reshape(-1, 2)[list(plan.is_spot)]
    return scene.survey.frame.to_local(route[:, 0], route[:, 1])
