# `make fly` and `make test` are all a newcomer needs. Both make the environment first; nothing outside .venv is touched.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/installed

.PHONY: fly test test-slow compatibility lint install lock schemas metrics studies clean

fly: install
	$(BIN)/dronecats fly --sitl

test: install lint
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow"

test-slow: install
	$(BIN)/python -m pytest -m slow

# Other people's scripts; docs/compatibility.md says what EXAMPLES and MAVSDK3 are, and is written by it.
compatibility: install
	$(BIN)/python -m pytest tests/system/compatibility/test_examples.py -v --examples "$(EXAMPLES)" --mavsdk3 "$(MAVSDK3)"

lint: install
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

install: $(STAMP)

$(STAMP): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "DroneCATS needs Python 3.11 or newer; name one with: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 2; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || { echo "the venv module is missing: on Debian and Ubuntu, apt install python3-venv" >&2; exit 2; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	@touch $@

# Rewrites the pins from pyproject.toml; run it when a dependency changes.
lock:
	$(PYTHON) -m venv $(VENV)-lock
	$(VENV)-lock/bin/pip install --quiet uv
	$(VENV)-lock/bin/uv pip compile --quiet --universal --python-version 3.11 --extra sim --extra dev --extra serial \
	    --no-emit-package dronecats --custom-compile-command "make lock" pyproject.toml -o requirements.lock
	rm -rf $(VENV)-lock

# Rewrites dronecats/rundir/schemas from the rows; run it when a row changes.
schemas: install
	$(BIN)/python -c "from dronecats.rundir.schema import write; write()"

# Rewrites the tables of docs/metrics.md from the registry; run it when a metric changes.
metrics: install
	$(BIN)/python -c "from pathlib import Path; from dronecats.metrics.page import write; write(Path('docs/metrics.md'))"

# Rewrites the table of docs/studies.md from the registry of factors; run it when a factor changes.
studies: install
	$(BIN)/python -c "from pathlib import Path; from dronecats.study.page import write; write(Path('docs/studies.md'))"

clean:
	rm -rf $(VENV) build dist *.egg-info
