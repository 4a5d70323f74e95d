"""Numbers of the paper's experiment, and those that it is silent about."""

from typing import Literal, get_args

MAP_ROWS, MAP_COLUMNS = 351, 391
LAUNCHES = ((79, 236), (207, 68))
"""Row and column; row 0 is in the south."""

THRESHOLDS = tuple(round(0.1 * k, 1) for k in range(1, 11))
RHO0 = 0.6
SAMPLES = 2500
"""Ours: so many end a voyage. The paper's sixth path ends after 1926; as many take longer here."""

NOISE_SHARE = 0.05
"""Ours: standard deviation of a reading, as a share of the field's."""

STANDOFF_CELLS = 0.25
"""Ours: kept from the shore, for a vessel that steers needs room. All water is mapped."""

PASSAGE_CELLS = 130
"""Ours: ways round land are found on a grid so fine, and straightened over the shore itself."""

MANUAL = (-2.0, 2.0, 1.0, 1.0)
LEARNED = (-4.6, 6.8, 3.4, 3.2)
"""Logarithms of noise variance, signal variance and length-scales east and north, these in map cells."""

RANDOM_SAMPLES = 50
"""The paper's "50 prior random samples": known before the launch."""

Ablation = Literal["spots-only", "replaced", "uncentred", "no-pilot"]
ABLATIONS: tuple[Ablation, ...] = get_args(Ablation)
"""Readings at the spots only; rho counts replacements only; zero is the prior's mean; nothing is known before."""
