# Each target does its own set-up: a fresh machine needs Python 3.11 or newer, make and a compiler.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready

# BLAS on one thread: unpinned, its threads fight with the worker process for the cores.
export OMP_NUM_THREADS = 1
export OPENBLAS_NUM_THREADS = 1
export MKL_NUM_THREADS = 1

.PHONY: help setup demo test accuracy routes soak-learning soak-authority soak-restarts soak-links soak-decoders soak-month systemd-test soak-shore soak-commands soak-bridge first-day fleet-test browser-test lint bench clean

help:
	@echo "make demo            a simulated vessel learns a patch of coast: three processes, about two minutes, one picture"
	@echo "make test            the test suite"
	@echo "make accuracy        the learner against exact processes, scikit-learn and moving seas, on many fields: an hour"
	@echo "make routes          planners against lawnmowers and shortest ways, on many coasts, and budgets at sea: an hour"
	@echo "make soak-learning   a million readings on one track: an hour"
	@echo "make soak-authority  a thousand surveys that operator and autopilot meddle with: ten minutes"
	@echo "make soak-restarts   two hundred times kill -9, twenty power cuts, an hour replayed: forty minutes"
	@echo "make soak-links      a hundred missions over a link that loses three in ten, every habit unhandled: fifty minutes"
	@echo "make systemd-test    the unit on a systemd booted in a container, with faults: as root, two minutes"
	@echo "make soak-shore      ten minutes without router, boat or listener, and a radio of 2400 bit/s: as root, an hour"
	@echo "make soak-commands   commands from ashore through losses, restarts of service and router, and wrong clocks: twenty minutes"
	@echo "make soak-bridge     an instrument at 20 Hz that is unplugged, and talks nonsense: an hour"
	@echo "make soak-decoders   a million damaged inputs for every reader of bytes from outside: half a day"
	@echo "make soak-month      a simulated month at sea under faults: two hours, alone on a core"
	@echo "make first-day       the pages of the path, typed in: from a polygon to a boat under way, and an instrument: ten minutes"
	@echo "make fleet-test      a hundred vessels and one shore process: three minutes"
	@echo "make browser-test    the page in a real Chromium: as root where chromium is missing, six minutes"
	@echo "make lint            style, types and import contracts"
	@echo "make bench           benchmarks, as ratios against references measured in the same run; benchmarks.json too"
	@echo "make clean           remove the virtual environment and caches"

$(READY): pyproject.toml autonomy/learning/_compiled.c
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[sim,shore,dev]'
	@touch $@

setup: $(READY)

demo: $(READY)
	$(BIN)/sim demo

test: $(READY)
	$(BIN)/python -m pytest -n 3 --dist worksteal --ignore=tests/benchmarks

# The short forms of these are part of the suite; the figures of real fields need HALOCLINE_DATA (see tests/conftest.py).
ACCURACY := $(BIN)/python -m pytest -q -s --timeout=14400
accuracy: $(READY)
	HALOCLINE_SEEDS=40 $(ACCURACY) tests/accuracy/test_fit_small.py
	HALOCLINE_SEEDS=10 $(ACCURACY) tests/accuracy/test_rebuild.py
	HALOCLINE_SEEDS=4 $(ACCURACY) tests/accuracy/test_moving.py
	HALOCLINE_ACCURACY=long $(ACCURACY) tests/accuracy/test_static_fields.py tests/accuracy/test_coverage.py \
		tests/accuracy/test_snapshots.py

routes: $(READY)
	HALOCLINE_ACCURACY=long $(ACCURACY) \
		tests/accuracy/test_route.py tests/accuracy/test_paper_distance.py tests/accuracy/test_passage.py \
		tests/accuracy/test_moving_voyages.py
	HALOCLINE_SEEDS=3 $(ACCURACY) tests/accuracy/test_patrol.py
	HALOCLINE_MISSIONS=500 $(ACCURACY) tests/property/test_budget.py
	HALOCLINE_VOYAGES=8 $(ACCURACY) tests/scenario/test_budget.py

soak-learning: $(READY)
	HALOCLINE_SOAK_UPDATES=1000000 $(BIN)/python -m pytest -q -s --timeout=14400 tests/unit/learning/test_learning_soak.py

soak-authority: $(READY)
	HALOCLINE_HUNDREDS=10 $(BIN)/python -m pytest -q -n 2 tests/property/test_authority.py

soak-restarts: $(READY)
	HALOCLINE_KILLS=200 HALOCLINE_CUTS=20 $(BIN)/python -m pytest -q -s --timeout=14400 \
		tests/process/test_resumption.py tests/process/test_power_cut.py
	HALOCLINE_REPLAY_S=3600 $(BIN)/python -m pytest -q -s --timeout=14400 tests/scenario/test_long_replay.py

soak-links: $(READY)
	HALOCLINE_UPLOADS=100 $(BIN)/python -m pytest -q -s --timeout=14400 tests/process/test_upload_over_bad_link.py
	HALOCLINE_UNHANDLED=1 $(BIN)/python -m pytest -q tests/scenario/test_habits_unhandled.py

soak-shore: $(READY)
	HALOCLINE_OUTAGE_S=600 $(BIN)/python -m pytest -q --timeout=14400 tests/process/test_outages.py
	HALOCLINE_THIN_S=300 $(BIN)/python -m pytest -q --timeout=14400 \
		tests/process/test_thin_link.py tests/process/test_service_lateness.py

soak-commands: $(READY)
	HALOCLINE_COMMANDS=20 $(BIN)/python -m pytest -q -s --timeout=3600 \
		tests/process/test_commands.py tests/scenario/test_directives.py

soak-bridge: $(READY)
	HALOCLINE_BRIDGE_S=3600 $(BIN)/python -m pytest -q --timeout=14400 tests/process/test_bridge.py -k twenty

systemd-test: $(READY)
	command -v systemd-nspawn || (apt-get update && apt-get install --yes systemd-container)
	HALOCLINE_BOOT=1 $(BIN)/python -m pytest -q -s tests/process/test_systemd.py

soak-decoders: $(READY)
	HALOCLINE_FUZZ=1000000 $(BIN)/python -m pytest -q -s --timeout=86400 tests/property/test_decoders.py
	HALOCLINE_LIES=100 $(BIN)/python -m pytest -q tests/property/test_lying_vehicle.py

soak-month: $(READY)
	HALOCLINE_MONTH_S=2750000 $(BIN)/python -m pytest -q -s --timeout=86400 tests/scenario/test_month.py

first-day: $(READY)
	HALOCLINE_FIRST_DAY=1 $(BIN)/python -m pytest -q \
		tests/process/test_first_day.py tests/process/test_desk_pages.py tests/process/test_bridge.py

fleet-test: $(READY)
	HALOCLINE_FLEET=100 $(BIN)/python -m pytest -q -s --timeout=600 tests/process/test_shore_serve.py -k fleet

browser-test: $(READY)
	command -v chromium || (apt-get update && apt-get install --yes chromium)
	ls $(VENV)/axe-core-*.tgz >/dev/null 2>&1 || (cd $(VENV) && npm pack --silent axe-core@4)
	HALOCLINE_BROWSER=1 $(BIN)/python -m pytest -q -s tests/browser

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(READY)
	$(BIN)/python -m pytest tests/benchmarks -q --timeout=0 --benchmark-quiet --benchmark-disable-gc \
		--benchmark-timer=time.process_time --benchmark-json=benchmarks.json

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache autonomy/learning/*.so
