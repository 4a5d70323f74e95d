"""Speed of the learner: ratios against linear algebra or a simpler way, in the same run."""

import pickle
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg.lapack import dpotrf

from autonomy.config import EstimationSection
from autonomy.learning.choice import choose
from autonomy.learning.fitting import Method, fit
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.learner import Learner
from autonomy.learning.rebuild import reestimate
from autonomy.learning.snapshot import PRECISIONS, decode, encode
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.structures import STRUCTURES, Scales

sys.path.insert(0, str(Path(__file__).parent))
from references import SPAN_M, H, cholesky, readings

CANDIDATES = EstimationSection().candidates
M = 100


def full_model(extent=SPAN_M):
    rng = np.random.default_rng(0)
    gp = SparseOnlineGP(H, M)
    while len(gp) < M:
        gp.update(rng.uniform(0, extent, 2), rng.normal())
    return gp


@pytest.mark.parametrize("objective", ["marginal", "loo"])
@pytest.mark.parametrize("name", ["squared_exponential", "long_short", "ou", "static_moving"])
@pytest.mark.parametrize("n", [200, 300])
def test_a_likelihood_with_its_gradient(report, seconds, objective, name, n):
    sample = readings(n)
    kernel = STRUCTURES[name].median(Scales(SPAN_M, 1.0, sample.elapsed_s))
    factorised = seconds(cholesky(n), 50)
    spent = seconds(lambda: getattr(sample, objective)(kernel), 50)
    report(f"{objective} and gradient, {name}, n = {n}", spent, "Cholesky", factorised)


def test_the_papers_ascent(report, seconds):
    sample, start = readings(100), Hyperparameters(0.5, 0.05, (15.0, 15.0)).kernel
    method = Method("loo", "gradient_ascent", False, 300)
    found = fit(sample, STRUCTURES["squared_exponential"], SPAN_M, start, method)
    spent = seconds(lambda: fit(sample, STRUCTURES["squared_exponential"], SPAN_M, start, method), 3)
    once = seconds(lambda: sample.loo(start), 5, 5)
    report(
        "fit, the paper's ascent, n = 100", spent, "LOO with gradient", once, f"{found.iterations} iterations"
    )


def test_a_choice(report, seconds):
    sample = readings(300)
    once = seconds(lambda: sample.marginal(H), 5, 5)
    first = choose(sample, CANDIDATES, SPAN_M)
    spent = seconds(lambda: choose(sample, CANDIDATES, SPAN_M), 3)
    note = f"{first.fit.structure} of {len(first.scores)}"
    report("choice from afar, n = 300", spent, "marginal with gradient", once, note)
    newer = readings(290)
    spent = seconds(lambda: choose(newer, CANDIDATES, SPAN_M, first.fit.structure, first.starts), 3)
    report("choice from the last one, n = 290", spent, "marginal with gradient", once)


def test_a_whole_reestimate(report, seconds):
    rng = np.random.default_rng(4)
    learner, at = Learner(SPAN_M, M), np.array([200.0, 200.0])
    for k in range(3000):
        at = np.clip(at + rng.normal(0.0, 4.0, 2), 0.0, SPAN_M)
        learner.add(at, float(np.sin(at[0] / 40.0) * np.cos(at[1] / 50.0) + 0.05 * rng.normal()), 10.0 * k)
    request = learner.reestimate_request(0, EstimationSection())
    cells = request.cells
    dense = H.kernel.covariance(cells.points, cells.points) + 0.01 * np.eye(len(cells))
    factorised = seconds(lambda: np.linalg.cholesky(dense), 3)
    spent = seconds(lambda: reestimate(request), 3)
    note = f"fit, new basis, {len(cells)} cells absorbed"
    report("re-estimate", spent, "Cholesky of all cells, densely", factorised, note)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_snapshots(report, seconds, precision):
    model = full_model().model()
    data, pickled = encode(model, None, precision), pickle.dumps(model)
    report(
        f"encode a snapshot, {precision}, m = 100",
        seconds(lambda: encode(model, None, precision), 7, 20),
        "pickle",
        seconds(lambda: pickle.dumps(model), 7, 20),
        f"{len(data)} bytes; pickle {len(pickled)}",
    )
    K = np.asfortranarray(H.kernel.covariance(model.basis, model.basis) + 0.01 * np.eye(M))
    report(
        f"decode a snapshot, {precision}, m = 100",
        seconds(lambda: decode(data), 7, 20),
        "Cholesky",
        seconds(lambda: dpotrf(K, lower=1), 50),
    )


@pytest.mark.parametrize("inducing", [100, 300])
def test_thin_snapshots(report, seconds, inducing):
    kernel = STRUCTURES["static_moving"].median(Scales(SPAN_M, 1.0, 3600.0))
    gp, rng = SparseOnlineGP(kernel, 200, 1e-6), np.random.default_rng(0)
    for point in rng.uniform(0, SPAN_M, (400, 2)):
        gp.advance(5.0)
        gp.update(point, rng.normal())
    model = gp.model()
    data = encode(model, None, "8 bit", inducing)
    spent = seconds(lambda: encode(model, None, "8 bit", inducing), 5)
    whole = seconds(lambda: encode(model, None, "8 bit"), 5)
    note = f"{len(data)} bytes, {len(decode(data))} places"
    report(f"three components, 200 vectors, at most {inducing}", spent, "group by group", whole, note)
