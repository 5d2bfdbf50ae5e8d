# Every command a newcomer or a developer needs. `make bench` and `make test` set up everything by themselves.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready

.PHONY: setup bench test test-slow boundscheck lint speed tables figures clean

setup: $(READY)

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $(READY)

bench: setup
	$(BIN)/python -m benchmark run --all --quick

test: setup
	$(BIN)/python -m pytest

test-slow: setup
	$(BIN)/python -m pytest -m slow

# The compiled kernels with every index checked; two minutes, most of them to compile.
boundscheck: setup
	$(BIN)/python -m tests.boundscheck

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

speed: setup
	$(BIN)/python -m tests.speed

tables: setup
	$(BIN)/python -m benchmark tables -o results/tables

figures: setup
	$(BIN)/python -m benchmark report -o results/report

clean:
	rm -rf $(VENV) results/runs
