"""Onboard autonomy for survey vessels: learn a map of the sea, decide where to sample next."""
