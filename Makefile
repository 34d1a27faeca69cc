# A newcomer needs `make fly` and `make test`. Each target makes its environment first and changes nothing outside .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
UV := uv==0.13.9
PYTEST := $(BIN)/python -m pytest
# Where this is set, every process compiles every import anew: seconds for each of a flight's.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: fly install install-dev check prepared unit test test-slow compatibility docs lock schemas metrics studies pictures clean

fly: install
	$(BIN)/dronecats fly --sitl

# What flying needs.
install: $(VENV)/fly.installed
# What the tests need as well.
install-dev: $(VENV)/dev.installed

# Ruff, mypy and the import contracts.
check: install-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Tests without processes, sockets, flights, browsers and rendering.
unit: install-dev
	$(PYTEST) -n 2 --dist worksteal -m unit

# Everything that a change should pass before it is shared. Three workers keep two cores busy: many tests wait.
test: install-dev
	$(MAKE) --jobs=2 check prepared
	$(PYTEST) -n 3 --dist worksteal -m "not slow"

# Compiles the kernels and builds the maps once. Otherwise every worker of the tests would do it for itself.
prepared: install-dev
	$(BIN)/python -m tests.support.prepared

# Whole flights in real time, commands of the docs, browsers, fits. Their order is that of tests/conftest.py.
test-slow: install-dev
	$(PYTEST) -n 3 --dist loadgroup --no-loadscope-reorder -m slow

# Scripts of other projects. docs/compatibility.md defines EXAMPLES and MAVSDK3 and is written by this target.
compatibility: install-dev
	$(PYTEST) tests/system/compatibility/test_examples.py -v --examples "$(EXAMPLES)" --mavsdk3 "$(MAVSDK3)"

# The documentation as a site, build/site/index.html. A broken link, or a page that docs/README.md omits, is an error.
docs: install-dev
	$(BIN)/python -m docs.website

$(VENV)/%.installed: requirements/%.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "DroneCATS needs Python 3.11 or newer; name one with: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 2; }
	@test -x $(BIN)/python || { echo "making the environment $(VENV) …"; $(PYTHON) -m venv $(VENV); } || { echo "the venv module is missing: on Debian and Ubuntu, apt install python3-venv" >&2; exit 2; }
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check $(UV) || echo "uv cannot be installed; pip is used instead, which is slower" >&2
	@echo "installing the packages of $< …"
	@$(BIN)/uv pip install --python $(BIN)/python -r $< -e . || \
	    $(BIN)/python -m pip install --disable-pip-version-check -r $< -e .
	@touch $@

# Rewrites the pins from pyproject.toml. Run it when a dependency changes.
LOCK := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --no-emit-package dronecats \
    --custom-compile-command "make lock" pyproject.toml
lock: install
	$(LOCK) --extra sim --extra vision -o requirements/fly.lock
	$(LOCK) --extra dev --constraints requirements/fly.lock -o requirements/dev.lock

# Rewrites foundation/run_folder/schemas and the episode record's schema from the types. Run it when a row or the record
# changes.
schemas: install
	$(BIN)/python -c "from foundation.run_folder.schema import write; write()"
	$(BIN)/python -c "from episodes.records.record import write_schema; write_schema()"

# Rewrites the tables of docs/metrics.md from the registry. Run it when a metric changes.
metrics: install
	$(BIN)/python -c "from pathlib import Path; from dronecats.study.docs_tables import write; write(Path('docs'), 'metrics.md')"

# Rewrites the tables of docs/studies.md and docs/disturbances.md. Run it when an option, a disturbance or a factor changes.
studies: install
	$(BIN)/python -c "from pathlib import Path; from dronecats.study.docs_tables import write; write(Path('docs'), 'studies.md', 'disturbances.md')"

# Rewrites flight.png, replay.jpg, watching.jpg and report-step.jpg of docs/pictures. Run it when what they show changes.
pictures: install-dev
	$(BIN)/python -m tests.docs.made_pictures

clean:
	rm -rf $(VENV) build dist *.egg-info
