"""What we believe: the sparse online Gaussian process, its hyperparameters and its memory."""

from autonomy.learning.choice import Choice, choose
from autonomy.learning.field_model import FieldModel, Prediction
from autonomy.learning.fitting import Fit, Method, fit
from autonomy.learning.history import History, HistoryCells
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.learner import Learner
from autonomy.learning.likelihood import log_marginal_likelihood, loo_log_likelihood
from autonomy.learning.rebuild import Reestimate, ReestimateRequest, reestimate
from autonomy.learning.snapshot import Snapshot, SnapshotError
from autonomy.learning.sparse_gp import SparseOnlineGP, Update

__all__ = [
    "Choice",
    "FieldModel",
    "Fit",
    "History",
    "HistoryCells",
    "Hyperparameters",
    "Learner",
    "Method",
    "Prediction",
    "Reestimate",
    "ReestimateRequest",
    "Snapshot",
    "SnapshotError",
    "SparseOnlineGP",
    "Update",
    "choose",
    "fit",
    "log_marginal_likelihood",
    "loo_log_likelihood",
    "reestimate",
]
