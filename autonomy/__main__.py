"""`python -m autonomy`."""

from autonomy.cli import entry

entry()
