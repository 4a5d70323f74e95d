"""Onboard autonomy for survey vessels: learn a map of the sea, decide where to sample next."""

__version__ = "0.1.0"
