# `make demo` and `make test` are all the set-up there is: both make a private environment first.
# PYTHON=python3.13 make test chooses another interpreter (3.11 to 3.14).
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := src tests benchmarks examples docs

.PHONY: demo test lint types pytest format fuzz kills reference picture screenshot paper clean

demo: $(VENV)/demo.stamp
	@echo "== rendering a capture with 12 lights and refining it (the first run also compiles)"
	$(BIN)/rakelight demo

test: lint types pytest

lint: $(VENV)/dev.stamp
	@echo "== lint"
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/ruff format --check $(SOURCES)

types: $(VENV)/dev.stamp
	@echo "== types"
	$(BIN)/mypy

# Two files of tests at a time: most of a test runs on one core.  In the order of their names, since
# the files with the most tests are not those that take longest.
# First the kernels, two processes at a time: each of the tests' processes would compile them all.
pytest: $(VENV)/dev.stamp
	@echo "== compiling"
	$(BIN)/python -m rakelight.cli.compiling | xargs -n 1 -P 2 $(BIN)/python -m rakelight.cli.compiling
	@echo "== tests"
	OMP_WAIT_POLICY=PASSIVE OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile \
		--no-loadscope-reorder

# Damaged files of every kind: a fixed seed and a fresh one; SEED=7 CASES=20000 chooses.  Then any
# arrays as captures, fresh ones at every run.
CASES ?= 10000
fuzz: $(VENV)/dev.stamp
	$(BIN)/python -m tests.faults.fuzz --cases $(CASES) $(if $(SEED),--seed $(SEED))
	$(BIN)/python -m pytest -q tests/capture/test_capture_arrays.py -k any_ \
		--hypothesis-profile=default

format: $(VENV)/dev.stamp
	$(BIN)/ruff check --fix $(SOURCES)
	$(BIN)/ruff format $(SOURCES)

# Runs killed while they write a result, 200 with a fixed seed and 200 with a fresh one;
# make kills SEED=5 takes this seed alone.
kills: $(VENV)/dev.stamp
	$(BIN)/python -m tests.faults.kills $(if $(SEED),--seed $(SEED))

# docs/reference/api.md, from the docstrings of the public names.
reference: $(VENV)/dev.stamp
	$(BIN)/python docs/api.py

# The README's picture, from the real capture of an oven mitten.
MITTEN ?= ../shared/captures/mitten
picture: $(VENV)/dev.stamp
	$(BIN)/rakelight refine $(MITTEN) -o out/mitten --overwrite
	cp out/mitten/preview.png docs/pictures/mitten.png

# The report's picture: the same mitten under raking light, in its page.
screenshot: $(VENV)/dev.stamp
	$(BIN)/rakelight refine $(MITTEN) -o out/mitten --overwrite
	$(BIN)/python benchmarks/report_picture.py out/mitten docs/pictures/report.png

# docs/results/paper.md and its pictures; four minutes on two cores.
paper: $(VENV)/dev.stamp
	$(BIN)/rakelight paper all -o out/paper --overwrite
	rm -rf docs/results/paper
	cp -r out/paper/paper out/paper/paper.md docs/results/

clean:
	rm -rf $(VENV) out .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(VENV)/demo.stamp: pyproject.toml
	@echo "== making a private environment in $(VENV)"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

$(VENV)/dev.stamp: $(VENV)/demo.stamp
	@echo "== adding the tools for tests to $(VENV)"
	$(BIN)/python -m pip install --quiet --editable ".[dev]"
	@touch $@
