# Everything a person runs. `make` alone lists the targets.
PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
STAMP := $(VENV)/.installed

.DEFAULT_GOAL := help
.PHONY: help setup test lint types layers pytest explore test38 package demo bench mutants docs format clean

help:  ## list the targets
	@grep -E '^[a-z0-9]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 10

setup: $(STAMP)  ## make the environment .venv (Python 3.11)

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; v == (3, 11) or sys.exit("duckpilot: expected Python 3.11 (PyBullet has no newer wheel), got %d.%d; try: make PYTHON=python3.11 ..." % v)'
	$(PYTHON) -m venv $(VENV)
	$(PY) -m pip install --quiet --upgrade pip
	$(PY) -m pip install --progress-bar on --constraint constraints.txt --editable '.[trainer,monitor,scale,lerobot,dev]'
	@touch $@

test: $(STAMP)  ## everything that CI runs, two parts at a time
	@$(MAKE) --no-print-directory --jobs 2 lint types layers pytest test38 package

lint: $(STAMP)  ## ruff: style and format
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .

types: $(STAMP)  ## mypy
	$(VENV)/bin/mypy

layers: $(STAMP)  ## the direction of imports
	$(VENV)/bin/lint-imports

pytest: $(STAMP)  ## the tests on Python 3.11
	$(PY) -m tests.warm
	$(PY) -m pytest --numprocesses 2 --dist worksteal

explore: $(STAMP)  ## the tests in full length, properties on examples drawn anew
	THOROUGH=1 HYPOTHESIS_PROFILE=explore $(PY) -m pytest --numprocesses 2 --dist worksteal

test38: $(STAMP)  ## the robot's tests on Python 3.8 with the Jetson Nano's wheels, where a 3.8 is found
	@bash tools/test38.sh

package: $(STAMP)  ## wheel and sdist, installed outside the repository and used
	$(PY) -m tests.package

demo: $(STAMP)  ## train a lane-keeping policy, export it, drive it through virtual hardware: runs/demo/
	$(PY) -m tools.demo --out runs/demo

bench: $(STAMP)  ## the tables of figures: runs/bench.json
	$(PY) -m tests.bench --out runs/bench.json

mutants: $(STAMP)  ## what the tests would miss, over hours, resumed where it stopped: runs/mutants/
	$(PY) -m tests.mutants --named
	nice -n 10 $(PY) -m tests.mutants

docs: $(STAMP)  ## the documents as a site: runs/site/index.html
	$(PY) -m pip install --quiet --constraint constraints.txt --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --strict

format: $(STAMP)  ## let ruff rewrite the style
	$(VENV)/bin/ruff check --fix .
	$(VENV)/bin/ruff format .

clean:  ## remove the environment and caches, keep runs/
	rm -rf $(VENV) .venv38 .pytest_cache .mypy_cache .ruff_cache .hypothesis
