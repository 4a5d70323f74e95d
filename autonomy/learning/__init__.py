"""What we believe: the sparse online Gaussian process, its hyperparameters and its memory."""

from autonomy.learning.field_model import FieldModel, Prediction
from autonomy.learning.history import History, HistoryCells
from autonomy.learning.hyperparameters import Fit, Priors, fit, log_marginal_likelihood, loo_log_likelihood
from autonomy.learning.kernel import Hyperparameters, covariance
from autonomy.learning.learner import Learner
from autonomy.learning.rebuild import Reestimate, ReestimateRequest, reestimate
from autonomy.learning.snapshot import Snapshot, SnapshotError
from autonomy.learning.sparse_gp import SparseOnlineGP, Update

__all__ = [
    "FieldModel",
    "Fit",
    "History",
    "HistoryCells",
    "Hyperparameters",
    "Learner",
    "Prediction",
    "Priors",
    "Reestimate",
    "ReestimateRequest",
    "Snapshot",
    "SnapshotError",
    "SparseOnlineGP",
    "Update",
    "covariance",
    "fit",
    "log_marginal_likelihood",
    "loo_log_likelihood",
    "reestimate",
]
