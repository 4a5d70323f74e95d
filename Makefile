# Each target does its own set-up: a fresh machine needs Python 3.11 or newer, make and a compiler.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready

# BLAS on one thread: unpinned, its threads fight with the worker process for the cores.
export OMP_NUM_THREADS = 1
export OPENBLAS_NUM_THREADS = 1
export MKL_NUM_THREADS = 1

.PHONY: help setup demo test lint bench clean

help:
	@echo "make demo    a simulated vessel learns a patch of coast: three processes, about two minutes, one picture"
	@echo "make test    the test suite"
	@echo "make lint    style, types and import contracts"
	@echo "make bench   benchmarks, as ratios against references measured in the same run"
	@echo "make clean   remove the virtual environment and caches"

$(READY): pyproject.toml autonomy/learning/_compiled.c
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[sim,shore,dev]'
	@touch $@

setup: $(READY)

demo: $(READY)
	$(BIN)/sim demo

test: $(READY)
	$(BIN)/python -m pytest -n 2 --ignore=tests/benchmarks

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(READY)
	$(BIN)/python -m pytest tests/benchmarks --benchmark-disable-gc -q

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
