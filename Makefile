# `make test` and `make demo` each set everything up in .venv on a fresh machine; a second run starts in seconds.
#   make test                   linters, types, import arrows, all tests
#   make test TESTS=tests/lift  only these tests
#   make demo                   from a drawn match to a rally that nobody played, rendered, on one page: demo/report.html
#   make demo VIDEO=path        the same from a video of yours

SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.PHONY: test lint demo

PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip install --disable-pip-version-check --progress-bar off -c constraints.txt
# Of pip's lines, those that say what is being fetched and installed.
BRIEFLY := { grep --line-buffered -v -E 'already satisfied|^ *Using cached|^Looking in|^ +(Preparing|Getting|Installing build)' || true; }
VIDEO ?=
TESTS ?=

# The tests run in two processes already; numpy and torch would start threads in each.
export OMP_NUM_THREADS ?= 1

test: .venv/installed $(if $(TESTS),,lint)
	@$(BIN)/python -m pytest -n 2 --dist worksteal $(TESTS)

lint: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports --no-logo

demo: .venv/installed
	@$(BIN)/pgm demo $(if $(VIDEO),--video '$(VIDEO)')

# torch first and pinned: whatever would swap it later then fails instead.
.venv/installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("pgm needs Python 3.11 or later" if sys.version_info < (3, 11) else 0)'
	@test -x $(BIN)/python || { echo "creating .venv"; $(PYTHON) -m venv .venv; }
	@echo "installing into .venv: 2 GB and some minutes the first time"
	@$(PIP) $$(grep '^torch==' constraints.txt) | $(BRIEFLY)
	@$(PIP) -e '.[test]' | $(BRIEFLY)
	@$(BIN)/python -c 'import torch, sys; \
	    sys.exit(0 if torch.__version__.startswith("2.13.0") else "torch: expected 2.13.0, got " + torch.__version__)'
	@$(BIN)/python -c 'import importlib.util, sys; \
	    sys.exit("torchvision: expected none, as it swaps torch" if importlib.util.find_spec("torchvision") else 0)'
	@touch $@
