"""How the error of the paper's voyages goes down, how it fluctuates on the way, and where it does."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression
from scipy.stats import spearmanr

from autonomy.geometry import FloatArray
from sim.experiment.cells import Result, Value

LOW, HIGH = 0.3, 0.7
"""Thresholds up to the one are low, from the other on high; the one that never re-estimates is neither."""

NEVER = 1.0


@dataclass(frozen=True)
class Course:
    """One voyage in figures. Errors are mean squares over the water, in squared units of the field.

    Attributes:
        launch: index of the launch.
        rho0: the threshold.
        seed: of the voyage.
        reestimates: so many were adopted.
        plans: so many were made.
        first, last: medians of the error over the first and the last third of the run.
        final: the error at the end.
        fluctuation: root mean square of ln(error) about the falling curve that fits it best: 0.1 is about 10 % of
            the error.
        rise: what ln(error) climbs in all, every step upwards added; a curve that only falls has 0.
        rise_at_fits: how much of that at the moments when a re-estimate is adopted.
        early_jump, late_jump: root mean squares of the steps of ln(error) at re-estimates, those adopted in the first
            third of the run and those after it; NaN: there was none.
        new_fits: so many of the re-estimates changed the hyperparameters; too few points or a failed fit keep them.
        longest_fit: the most samples that were taken under the same hyperparameters.
    """

    launch: int
    rho0: float
    seed: int
    reestimates: int
    plans: int
    first: float
    last: float
    final: float
    fluctuation: float
    rise: float
    rise_at_fits: float
    early_jump: float
    late_jump: float
    new_fits: int
    longest_fit: int

    @property
    def falls(self) -> bool:
        """Whether the last third is better than the first."""
        return self.last < self.first


@dataclass(frozen=True)
class Claim:
    """What the voyages say of "more error fluctuations for low rho0", by one measure of fluctuation.

    Attributes:
        correlation, p: Spearman's, between rho0 and the measure over all voyages that may re-estimate, and the chance
            of one so strong without any.
        low, high: means of the measure under low and high thresholds.
    """

    correlation: float
    p: float
    low: float
    high: float

    @property
    def holds(self) -> bool | None:
        """Whether low thresholds fluctuate more; None: the voyages can't tell."""
        if not self.p < 0.05:
            return None
        return self.correlation < 0.0


def course_of(result: Result) -> Course:
    """The figures of a voyage that `sim.experiment.paper_cells` has sailed."""
    values, arguments = result.values, result.cell.arguments
    samples, error = _column(values, "samples"), _column(values, "mse")
    first, last = thirds(samples, error)
    fits, jumps = _column(values, "fit_samples"), _jumps(values)
    changes = fits[~np.asarray(values["fit_kept"], dtype=bool)]
    early = fits <= _thirds_end(samples)[0]
    return Course(
        launch=int(arguments["launch"]),
        rho0=float(arguments["rho0"]),
        seed=int(arguments["seed"]),
        reestimates=len(fits),
        plans=len(_column(values, "plan_samples")),
        first=first,
        last=last,
        final=float(error[-1]),
        fluctuation=fluctuation(error),
        rise=_rise(samples, error, values),
        rise_at_fits=float(jumps[jumps > 0.0].sum()),
        early_jump=_rms(jumps[early]),
        late_jump=_rms(jumps[~early]),
        new_fits=len(changes),
        longest_fit=int(np.diff([0.0, *changes, samples[-1]]).max()),
    )


def thirds(samples: FloatArray, error: FloatArray) -> tuple[float, float]:
    """Medians of the error over the first and over the last third of a run; both arrays have shape (n,).

    The run begins where there is something to judge, with the first model.
    """
    ends = _thirds_end(samples)
    return float(np.median(error[samples <= ends[0]])), float(np.median(error[samples > ends[1]]))


def fluctuation(error: FloatArray) -> float:
    """Root mean square of ln(error), shape (n,), about the falling curve that fits it best."""
    logs = np.log(error)
    return _rms(logs - isotonic_regression(logs, increasing=False).x)


def claim_of(courses: Sequence[Course], measure: Callable[[Course], float]) -> Claim:
    """What the voyages say of the paper's claim; at least three of them must be allowed to re-estimate."""
    tried = [each for each in courses if each.rho0 < NEVER]
    found = spearmanr([each.rho0 for each in tried], [measure(each) for each in tried])
    low = [measure(each) for each in tried if each.rho0 <= LOW]
    high = [measure(each) for each in tried if each.rho0 >= HIGH]
    return Claim(float(found.statistic), float(found.pvalue), _mean(low), _mean(high))


def geometric_mean(numbers: Sequence[float]) -> float:
    """Of positive numbers; NaN of none."""
    return float(np.exp(np.mean(np.log(numbers)))) if len(numbers) else float("nan")


def _thirds_end(samples: FloatArray) -> tuple[float, float]:
    """After how many samples the first and the second third of a run end."""
    length = float(samples[-1] - samples[0])
    return float(samples[0]) + length / 3.0, float(samples[0]) + length * 2.0 / 3.0


def _rise(samples: FloatArray, error: FloatArray, values: Mapping[str, Value]) -> float:
    """Every step upwards of ln(error), between judgements and at re-estimates, in the order of samples."""
    fits = _column(values, "fit_samples")
    # A judgement at the sample of a re-estimate was made before it: the job took a moment.
    at = np.concatenate([samples, fits, fits])
    order = np.concatenate([np.zeros(len(samples)), np.ones(len(fits)), np.full(len(fits), 2.0)])
    logs = np.log(np.concatenate([error, _column(values, "fit_before"), _column(values, "fit_after")]))
    steps = np.diff(logs[np.lexsort([order, at])])
    return float(steps[steps > 0.0].sum())


def _jumps(values: Mapping[str, Value]) -> FloatArray:
    """Steps of ln(error) at re-estimates, shape (r,); one that only made the first model has no error before."""
    return np.log(_column(values, "fit_after")) - np.log(_column(values, "fit_before"))


def _rms(numbers: FloatArray) -> float:
    return float(np.sqrt(np.mean(numbers**2))) if len(numbers) else float("nan")


def _mean(numbers: Sequence[float]) -> float:
    return float(np.mean(numbers)) if len(numbers) else float("nan")


def _column(values: Mapping[str, Value], name: str) -> FloatArray:
    return np.asarray(values[name], dtype=float)
