"""A dry run in words, in numbers and as a picture."""

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from autonomy.wire import PlanNotice
from sim.plots import demo_figure
from sim.rehearsal.doubts import doubts_of
from sim.rehearsal.outcome import Outcome


def plain(outcome: Outcome) -> dict[str, Any]:
    """For a program: numbers, in the units that their names say."""
    sailed, last = outcome.sailed, outcome.sailed.moments[-1]
    return {
        "succeeded": outcome.succeeded,
        "home": sailed.is_home,
        "field": sailed.truth.field.info.description,
        "km": round(sailed.km, 3),
        "hours": round(sailed.hours, 4),
        "energy_wh": None if sailed.energy_wh is None else round(sailed.energy_wh, 2),
        "limits": [{**asdict(limit), "share": limit.share} for limit in outcome.limits],
        "phases_s": {name: round(seconds, 1) for name, seconds in sailed.phases_s.items()},
        "plans": [_plain_plan(plan) for plan in sailed.plans],
        "samples": last.samples,
        "basis_size": len(sailed.basis_m),
        "reestimates": sailed.reestimates,
        "field_std": sailed.field_std,
        "noise_std": sailed.noise,
        "rmse_expected": last.expected,
        "rmse": last.rmse,
        "course": [asdict(moment) for moment in sailed.moments],
        "legs_over_land": outcome.legs_over_land,
        "warnings": [asdict(doubt) for doubt in doubts_of(outcome)],
    }


def told(outcome: Outcome) -> list[str]:
    """For a person."""
    sailed, last, std = outcome.sailed, outcome.sailed.moments[-1], outcome.sailed.field_std
    info = sailed.truth.field.info
    end = "and home" if sailed.is_home else "not home"
    reasons = Counter(plan.reason.split(" (")[0] for plan in sailed.plans)
    plans = ", ".join(reason if n == 1 else f"{reason} ({n} times)" for reason, n in reasons.items())
    phases = ", ".join(f"{name} {_duration(s)}" for name, s in sailed.phases_s.items())
    return [
        f"sea        {info.description}; standard deviation {std:.3g}, noise {sailed.noise:.2g}",
        f"probe      a reading every {sailed.reading_s:.3g} s, {last.samples} learnt, "
        f"{len(sailed.basis_m)} basis vectors",
        f"sailed     {sailed.km:.2f} km in {_duration(3600.0 * sailed.hours)}, {end}",
        f"phases     {phases}",
        f"budget     {', '.join(map(str, outcome.limits)) or 'none'}",
        f"energy     {'not known' if sailed.energy_wh is None else f'{sailed.energy_wh:.1f} Wh'}",
        f"plans      {len(sailed.plans)}: {plans}",
        f"map        wrong by {last.rmse:.3g} = {last.rmse / std:.0%} of the field's standard deviation; "
        f"the model expects {last.expected:.3g} = {last.expected / std:.0%}",
    ]


def draw(outcome: Outcome, path: Path) -> None:
    """Truth, nowcast and standard deviation with the track, and the error as it fell. OSError if it can't be."""
    sailed, to_local = outcome.sailed, outcome.survey.frame.to_local
    truth, info = sailed.truth, sailed.truth.field.info
    spots = [place for plan in sailed.plans for place in _spots(plan)]
    last = sailed.moments[-1]
    demo_figure(
        path,
        truth.x_axis_m,
        truth.y_axis_m,
        truth.truth(3600.0 * last.hours),
        sailed.mean,
        sailed.deviation,
        to_local(*sailed.track_deg.T),
        sailed.basis_m,
        to_local(*np.asarray(spots, dtype=float).reshape(-1, 2).T),
        [moment.samples for moment in sailed.moments],
        [moment.rmse for moment in sailed.moments],
        sailed.field_std,
        info.long_name,
        info.units,
        f"{outcome.configuration.survey.name}: {sailed.km:.1f} km in {_duration(3600.0 * sailed.hours)}, "
        f"plans: {len(sailed.plans)}, error {last.rmse / sailed.field_std:.0%} of the field's standard deviation",
    )


def _spots(plan: PlanNotice) -> list[tuple[float, float]]:
    return [place for place, is_spot in zip(plan.route_deg, plan.is_spot, strict=True) if is_spot]


def _plain_plan(plan: PlanNotice) -> dict[str, Any]:
    return {
        "reason": plan.reason,
        "planner": plan.planner,
        "corners": len(plan.route_deg),
        "spots": sum(plan.is_spot),
        "expected_rmse": plan.expected_rmse,
    }


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
