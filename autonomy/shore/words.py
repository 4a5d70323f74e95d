"""What a snapshot says of the field and of itself, in a few words; for the terminal and below the picture."""

import math

from autonomy.learning.calibration import CalibrationFigures
from autonomy.learning.description import describe
from autonomy.learning.transform import Identity
from autonomy.wire import ModelSnapshot


def belief(model: ModelSnapshot) -> str:
    """The kernel with the standard deviations of field and noise: "σf 0.24  smooth 3.1 km  σn 0.021"."""
    kernel, transform = model.kernel, model.model.transform
    unit = "" if model.units in ("", "1") else f" {model.units}"
    if not isinstance(transform, Identity):
        unit = f" ({transform.name})"
    signal, noise = math.sqrt(kernel.signal_variance), math.sqrt(kernel.noise_variance)
    return f"σf {signal:.3g}{unit}  {describe(kernel)}  σn {noise:.2g}{unit}"


def agreement(model: ModelSnapshot) -> str:
    """How often the 95 % intervals held: "95 % intervals held 94 % of 500 readings, 91 % of 43 ahead"."""
    if not model.calibration.count:
        return "95 % intervals untested"
    ahead = f", {_share(model.ahead)} ahead" if model.ahead.count else ""
    return f"95 % intervals held {_share(model.calibration)} readings{ahead}"


def _share(figures: CalibrationFigures) -> str:
    return f"{figures.coverage_95:.0%} of {figures.count}".replace("%", " %")
