"""Handing surveys on: what a vehicle told ashore, or what its journal holds, as files that others read."""
