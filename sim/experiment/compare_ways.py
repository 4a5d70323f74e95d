"""The strategies that are compared, and how they are called."""

OURS, PAPER = "halocline", "paper"
ON_BOARD = (OURS, PAPER)
"""Whose decisions are the core's."""

LANES = ("lawnmower-along", "lawnmower-across")
"""Lawnmowers with lanes along the longer and along the shorter side of the area."""

SAILED = (*ON_BOARD, *LANES, "random", "entropy", "information")
"""What is sailed."""

BETTER_LANES = "lawnmower-better"
ROWS = (OURS, PAPER, "lawnmower", BETTER_LANES, "random", "entropy", "information")
"""What is told: of the two lawnmowers their mean, for one has to be chosen beforehand, and the one that did better."""

TITLES = {
    OURS: "**Halocline**",
    PAPER: "the paper's profile",
    "lawnmower": "lawnmower",
    BETTER_LANES: "lawnmower, better direction in hindsight",
    "random": "random waypoints",
    "entropy": "greedy entropy",
    "information": "greedy MI + tour",
}

COLOURS = {
    OURS: "#d55e00",
    PAPER: "#0072b2",
    "lawnmower": "#333333",
    BETTER_LANES: "#888888",
    "random": "#e6a400",
    "entropy": "#009e73",
    "information": "#cc79a7",
}
"""Told apart by everybody (Okabe & Ito 2008), the same in all pictures."""
