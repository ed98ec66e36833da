# The first Python that is new enough; the lock file was made for 3.11.
PYTHON ?= $(shell for p in python3.11 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
BIN := .venv/bin
STAMP := .venv/.stamp-setup
PIP := $(BIN)/python -m pip --disable-pip-version-check --no-input

# An environment with the oldest versions that pyproject.toml allows, and what is tested with it: all that depends on
# them, and not the long searches.
OLDEST := .venv-minimum
OLDEST_TESTS := $(addprefix tests/,house/test_imports.py house/test_jax_version.py config/test_config.py \
	config/test_template.py commands/test_cli.py commands/test_cli_path.py materials/test_materials.py \
	shell/test_shell_values.py pneunet/test_chamber.py)

.PHONY: help setup run test test-all test-minimum check lint bench docs notebooks

help:
	@echo "make setup   a virtual environment in .venv, from requirements.lock"
	@echo "make run     set-up, then the design search of configs/finger_tip_force.toml"
	@echo "make test    set-up, then the tests"
	@echo "make test-all    set-up, then the tests and the long sweeps among them, through optimised programs (an hour)"
	@echo "make test-minimum   some of the tests with the oldest versions that pyproject.toml allows"
	@echo "make check   set-up, then wide random checks: a million shells, 100,000 fingers, all derivatives (hours)"
	@echo "make lint    set-up, then ruff and pyright"
	@echo "make bench   set-up, then speed against error: docs/speed-and-error.md with its tables and pictures"
	@echo "make docs    set-up, then the documentation in site/, warnings as errors"
	@echo "make notebooks   set-up, then the notebooks from their text sources, with outputs"

setup: $(STAMP)

$(STAMP): requirements.lock pyproject.toml
	@test -n "$(PYTHON)" || { echo "softgrip_jax needs Python 3.11 or newer on the PATH."; exit 1; }
	$(PYTHON) -m venv .venv
	$(PIP) install --quiet --require-hashes -r requirements.lock
	$(PIP) install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

run: setup
	$(BIN)/softgrip design configs/finger_tip_force.toml

test: setup
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

test-all: setup
	JAX_DISABLE_MOST_OPTIMIZATIONS=0 $(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder -m "slow or not slow"

test-minimum: $(OLDEST)/.stamp-setup
	$(OLDEST)/bin/python -m pytest -n auto --maxprocesses 4 --dist loadfile $(OLDEST_TESTS)

check: setup
	$(BIN)/python tests/wide

$(OLDEST)/.stamp-setup: pyproject.toml
	@test -n "$(PYTHON)" || { echo "softgrip_jax needs Python 3.11 or newer on the PATH."; exit 1; }
	$(PYTHON) -m venv $(OLDEST)
	$(PYTHON) -c 'import re, tomllib; project = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
		print(*(re.sub(r">=([\d.]+).*", r"==\1", need) for need in project["dependencies"]), sep="\n")' > $(OLDEST)/oldest.txt
	$(OLDEST)/bin/python -m pip --disable-pip-version-check --no-input install --quiet \
		--constraint $(OLDEST)/oldest.txt --editable ".[test]"
	@touch $@

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python

bench: setup
	$(BIN)/python -m benchmarks.speed

docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

notebooks: setup
	$(BIN)/python docs/run_notebooks.py
