"""What the paper's experiment has shown, in words and tables that follow from its figures."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from sim.experiment.paper_numbers import LAUNCHES
from sim.experiment.paper_statistics import HIGH, LOW, NEVER, Claim, Course, claim_of, geometric_mean

_TITLES = {
    "figure-1-field": "Figure 1: the field",
    "figure-2-by-hand": "Figure 2: truth and prediction, hyperparameters by hand",
    "figure-3-spots": "Figure 3: sampling spots",
    "figure-4-paths": "Figure 4: paths",
    "figure-5-models": "Figure 5: models",
    "figure-6-variances": "Figure 6: variances",
    "figure-7-errors": "Figure 7: errors",
    "figure-8-fluctuation": "Fluctuation",
}


def report(facts: Mapping[str, str], courses: Sequence[Course], captions: Mapping[str, str]) -> str:
    """The report in Markdown; pictures lie beside it, under the names of `captions`."""
    parts = ["# The paper's experiment\n", "\n".join(f"- {name}: {said}" for name, said in facts.items())]
    parts += ["## Errors fall in every setting\n" if all(c.falls for c in courses) else "## Errors\n"]
    parts += [falling(courses), thirds_table(courses)]
    parts += ["## Does a low ρ₀ fluctuate more?\n", *verdict(courses)]
    for name, said in captions.items():
        parts += [f"## {_TITLES[name]}\n", f"![{said}]({name}.png)\n", f"*{said}*"]
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def falling(courses: Sequence[Course]) -> str:
    """Whether the last third is better than the first, and where it is not."""
    rises = [each for each in courses if not each.falls]
    said = f"In {len(courses) - len(rises)} of {len(courses)} voyages the median error of the last third of the run is "
    said += "below that of the first third."
    if rises:
        where = "; ".join(
            f"launch {LAUNCHES[each.launch]}, ρ₀ {each.rho0:g}, seed {each.seed}: {each.first:.3g} to {each.last:.3g}"
            for each in rises
        )
        lasting = ", ".join(str(each.longest_fit) for each in rises)
        said += (
            f" It is not for {where}. The same hyperparameters lasted there for {lasting} samples: ρ begins anew with "
            "every path, and under a high ρ₀ a full basis is not renewed enough before the path ends."
        )
    return said


def thirds_table(courses: Sequence[Course]) -> str:
    """Medians of the mean square error over the first and the last third, for each launch and threshold."""
    launches = sorted({each.launch for each in courses})
    head = ["ρ₀"]
    for launch in launches:
        head += [f"{LAUNCHES[launch]}: first third", "last third", "last / first"]
    rows = []
    for rho0 in sorted({each.rho0 for each in courses}):
        row = [f"{rho0:.1f}"]
        for launch in launches:
            these = [each for each in courses if (each.launch, each.rho0) == (launch, rho0)]
            first = geometric_mean([each.first for each in these])
            last = geometric_mean([each.last for each in these])
            row += [f"{first:.3g}", f"{last:.3g}", f"{last / first:.2f}"]
        rows.append(row)
    return _table(head, rows)


def verdict(courses: Sequence[Course]) -> list[str]:
    """Paragraphs: whether the paper's claim holds for these voyages, and where their errors climb."""
    tried = [each for each in courses if each.rho0 < NEVER]
    if len({each.rho0 for each in tried}) < 3:
        return ["Too few thresholds were tried to tell."]
    voyages = f"Over {len(tried)} voyages with ρ₀ < 1, by two measures:"
    strays = _whether("How far the error strays from its trend", claim_of(courses, lambda c: c.fluctuation))
    climbs = _whether("How much the error climbs in all", claim_of(courses, lambda c: c.rise))
    return [voyages, f"- {strays}\n- {climbs}", fluctuation_table(courses), _why(tried)]


def fluctuation_table(courses: Sequence[Course]) -> str:
    """By threshold: how often the model was re-estimated, and how its error strayed and climbed."""
    head = [
        "ρ₀",
        "re-estimates",
        "new θ",
        "same θ at most",
        "plans",
        "fluctuation",
        "climbs",
        "at re-estimates",
    ]
    head.append("final MSE")
    rows = []
    for rho0 in sorted({each.rho0 for each in courses}):
        these = [each for each in courses if each.rho0 == rho0]
        rows.append(
            [
                f"{rho0:.1f}",
                f"{_mean(these, lambda c: c.reestimates):.1f}",
                f"{_mean(these, lambda c: c.new_fits):.1f}",
                f"{_mean(these, lambda c: c.longest_fit):.0f}",
                f"{_mean(these, lambda c: c.plans):.1f}",
                f"{geometric_mean([each.fluctuation for each in these]):.3f}",
                f"{_mean(these, lambda c: c.rise):.2f}",
                f"{_mean(these, lambda c: c.rise_at_fits):.2f}",
                f"{geometric_mean([each.final for each in these]):.3g}",
            ]
        )
    said = (
        "Fluctuation is the root mean square of ln(MSE) about the falling curve that fits it best (isotonic "
        'regression); what it climbs is the sum of all its steps upwards. "Same θ at most" is the most samples under '
        "the same hyperparameters. Means over launches and seeds, geometric for fluctuation and error."
    )
    return f"{_table(head, rows)}\n\n{said}"


def _whether(measure: str, claim: Claim) -> str:
    answers = {
        True: "more under a low ρ₀, as the paper found",
        False: "less under a low ρ₀",
        None: "no telling",
    }
    return (
        f"{measure}: **{answers[claim.holds]}**. Rank correlation (Spearman) with ρ₀ {claim.correlation:+.2f} "
        f"(p = {claim.p:.2g}); mean {claim.low:.3g} up to ρ₀ = {LOW:g}, {claim.high:.3g} from ρ₀ = {HIGH:g} on."
    )


def _why(tried: Sequence[Course]) -> str:
    """The paper's reason, early re-estimates from a part of the map, held against the figures."""
    low = [each for each in tried if each.rho0 <= LOW]
    high = [each for each in tried if each.rho0 >= HIGH]
    share = sum(each.rise_at_fits for each in tried) / max(1e-12, sum(each.rise for each in tried))
    return (
        f"A low ρ₀ (up to {LOW:g}) re-estimates {_mean(low, lambda c: c.reestimates):.0f} times in a run, and "
        f"{_mean(low, lambda c: c.new_fits):.0f} of these change the hyperparameters; a high one (from {HIGH:g} on) "
        f"{_mean(high, lambda c: c.reestimates):.1f} and {_mean(high, lambda c: c.new_fits):.1f} times. A single "
        f"re-estimate changes ln(MSE) by {_rms(low, early=True)} (root mean square) in the first third of the run "
        f"and by {_rms(low, early=False)} afterwards under a low ρ₀, by {_rms(high, early=True)} and "
        f"{_rms(high, early=False)} under a high one. Of all that the errors climb, {share:.0%} happens at the "
        "moment of a re-estimate. The rest comes between them, when the map goes on under hyperparameters that were "
        f"found from a part of the sea; the same ones last for up to {_mean(low, lambda c: c.longest_fit):.0f} samples "
        f"under a low ρ₀, for up to {_mean(high, lambda c: c.longest_fit):.0f} under a high one."
    )


def _rms(courses: Sequence[Course], *, early: bool) -> str:
    """Root mean square of the voyages' jumps at re-estimates, in words."""
    jumps = np.array([each.early_jump if early else each.late_jump for each in courses])
    known = jumps[np.isfinite(jumps)]
    return f"{np.sqrt(np.mean(known**2)):.2f}" if len(known) else "nothing, for there was none,"


def _mean(courses: Sequence[Course], of: Callable[[Course], float]) -> float:
    return float(np.mean([of(each) for each in courses])) if courses else float("nan")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}", *(f"| {' | '.join(row)} |" for row in rows)]
    return "\n".join(lines)
