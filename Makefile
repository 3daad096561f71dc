# Needs Python 3.11 and make; everything else is installed into .venv, with the versions of constraints.txt.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
OUT ?= reproduction
BIN := .venv/bin
READY := .venv/.installed
# Build tools are pinned as well, in the isolated environments that pip makes for them.
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
# One math thread a process: results are the same to the bit, and processes do the rest.
export OMP_NUM_THREADS ?= 1

.PHONY: reproduce test test-all bench audit lint format docs dist clean

reproduce: $(READY)  ## the main job: reproduce the paper into $(OUT)
	$(BIN)/bodyimage-kin reproduce --out $(OUT)

test: $(READY)  ## the default tests, under ten minutes on two cores
	$(BIN)/pytest -n 2

test-all: $(READY)  ## the slow, exhaustive ones as well
	$(BIN)/pytest -n 2 -m ""

bench: $(READY)  ## speed and accuracy of every kinematics engine installed, written beside comparisons/speed/run.py
	$(BIN)/python comparisons/speed/run.py
	$(BIN)/python comparisons/speed/studies.py

audit: $(READY)  ## every number that a page gives as a result, held against the committed results
	$(BIN)/python comparisons/audit.py

lint: $(READY)  ## style and types
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

docs: $(READY)  ## the documentation into docs/_build/html, warnings as errors
	$(BIN)/sphinx-build -E -W --keep-going -n -q docs docs/_build/html

dist: $(READY)  ## wheel and sdist into dist/, and the wheel tried in fresh environments of every Python found
	$(BIN)/python .ci/dist

format: $(READY)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf .venv dist reproduction .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(READY): pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev,docs]"
	touch $@
