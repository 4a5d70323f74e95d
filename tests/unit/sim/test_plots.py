from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from sim.plots import demo_figure


def arguments() -> dict[str, Any]:
    x, y = np.linspace(-7000.0, 7000.0, 60), np.linspace(-5000.0, 5000.0, 45)
    truth = 33.4 + 0.1 * np.sin(x / 2000.0) * np.cos(y[:, None] / 1500.0)
    truth[30:, 40:] = np.nan
    rng = np.random.default_rng(0)
    return {
        "x_axis_m": x,
        "y_axis_m": y,
        "truth": truth,
        "mean": np.nan_to_num(truth, nan=33.4) + 0.01,
        "standard_deviation": np.full(truth.shape, 0.02) * (1.0 + rng.random(truth.shape)),
        "track_m": np.cumsum(rng.normal(0.0, 300.0, (80, 2)), axis=0),
        "basis_m": rng.uniform(-4000.0, 4000.0, (30, 2)),
        "spots_m": rng.uniform(-4000.0, 4000.0, (12, 2)),
        "samples": np.arange(1, 300, 20),
        "rmse": 0.08 * np.exp(-np.arange(15) / 4.0),
        "field_std": 0.08,
        "label": "sea surface salinity",
        "units": "PSU",
        "title": "a survey",
    }


def test_the_picture_is_1600_pixels_wide(tmp_path: Path) -> None:
    path = tmp_path / "demo.png"
    demo_figure(path, **arguments())
    image = imread(path)
    assert image.shape[1] == 1600
    assert image[..., :3].std() > 0.1


@pytest.mark.parametrize(
    "change",
    [
        pytest.param({"basis_m": [], "spots_m": [], "track_m": []}, id="before the first sample"),
        pytest.param({"samples": [], "rmse": []}, id="never evaluated"),
        pytest.param({"samples": [5], "rmse": [0.07], "units": ""}, id="one evaluation, no unit"),
        pytest.param({"truth": np.full((45, 60), 33.0), "mean": np.full((45, 60), 33.0)}, id="flat, no land"),
        pytest.param({"standard_deviation": np.zeros((45, 60))}, id="certain"),
    ],
)
def test_odd_surveys_are_drawn_too(tmp_path: Path, change: dict[str, Any]) -> None:
    path = tmp_path / "demo.png"
    demo_figure(path, **{**arguments(), **change})
    assert path.stat().st_size > 10_000
