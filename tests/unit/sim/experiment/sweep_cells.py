"""Functions of cells, for workers to import. Each leaves a file for every time it was called."""

import os
import signal
import time
import uuid
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_info

WAITING_S = 120.0


def _called(arguments):
    folder = Path(arguments["calls"]) / str(arguments["seed"])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{uuid.uuid4()}").write_text(str(os.getpid()))


def linear_algebra(arguments):
    """Draws and factorises, at sizes where a BLAS on two threads has other last digits than on one."""
    _called(arguments)
    rng = np.random.default_rng(arguments["seed"])
    A = rng.normal(size=(300, 300))
    root = np.linalg.cholesky(A @ A.T + np.eye(300))
    return {
        "root": root,
        "log_determinant": float(np.sum(np.log(np.diag(root)))),
        "blas_threads": max(pool["num_threads"] for pool in threadpool_info()),
    }


def waiting(arguments):
    """From some seed on, cells wait until a file that ends with their seed is there."""
    _called(arguments)
    deadline = time.monotonic() + WAITING_S
    file = Path(f"{arguments['until']}{arguments['seed']}")
    while arguments["seed"] >= arguments["waits_from"] and not file.exists():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return {"value": float(np.random.default_rng(arguments["seed"]).normal())}


def misbehaving(arguments):
    """As `arguments["does"]` says."""
    _called(arguments)
    match arguments["does"]:
        case "raise":
            raise ValueError("the sea is too calm")
        case "die":
            os.kill(os.getpid(), signal.SIGKILL)
        case "return a dictionary":
            return {"value": {}}
    return {"value": arguments["seed"]}


def reading(arguments):
    """The text of a file."""
    _called(arguments)
    return {"text": Path(arguments["file"]).read_text()}
