# Two commands to start with: `make demo` (from recipe to leaderboard) and `make test`. Both set up .venv.
# Outside .venv only libllvm19 is installed, and chromium for the tests, both by apt, if the user has the permission.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
BROWSER := $(VENV)/.browser
KERNELS := $(VENV)/.kernels
ENCODER := $(VENV)/.encoder
DOCS := $(VENV)/.docs
# The tests start many commands. Without bytecode, each of them would compile the package again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help install demo test test-fast test-long lint compiled-tests checked validate bench gpu-report docs clean
help:
	@echo "make demo       go from recipe to leaderboard: render, encode, evaluate (a minute, after a minute of set-up)"
	@echo "make test       run linters, type checks and all tests but the long ones (ten minutes on two cores)"
	@echo "make test-fast  run linters, type checks and the short tests (two to three minutes)"
	@echo "make test-long  run the long tests, as every night: a tenth of the paper's grid at full size, all planted faults, all cases"
	@echo "make validate   check every law at full size, and write studies/results/validation.md (a quarter of an hour; the same command resumes)"
	@echo "make bench      measure speed, file size and memory against their targets (about twenty minutes)"
	@echo "make gpu-report  test and time the renderer on an NVIDIA card, and write gpu-report.md to paste into an issue"
	@echo "make docs       build the documentation site: build/site/index.html (half a minute)"
	@echo "make install    set up .venv, and nothing else"
	@echo "make clean      remove what the other commands made, except .venv"

install: $(STAMP)

$(STAMP): pyproject.toml tools/install-llvm.sh
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "saf_gen needs Python 3.11 or newer; this is " + sys.version.split()[0] + ": run make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[render,test,validation]'
	@sh tools/install-llvm.sh
	@touch $@

demo: install
	$(BIN)/saf-gen generate recipes/quickstart.yaml --out datasets/quickstart
	$(BIN)/saf-gen evaluate datasets/quickstart

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

$(BROWSER): $(STAMP) tools/install-chromium.sh
	@sh tools/install-chromium.sh
	@touch $@

# Numba's kernels are compiled once for all test processes, while the linters run and the tests are compiled.
$(KERNELS): $(STAMP) $(wildcard saf_gen/render/*.py saf_gen/camera/*.py saf_gen/core/*.py saf_gen/benchmark/view/*.py)
	@$(BIN)/python tests/helpers/compile_kernels.py renderer
	@touch $@

compiled-tests: lint
	@said=$$($(BIN)/pytest --collect-only -q -n 0 2>&1) || { echo "$$said" | tail -30; exit 1; }

# The encoder's kernels follow the linters, which take less time than the renderer's kernels.
$(ENCODER): $(STAMP) $(wildcard saf_gen/camera/*.py) | compiled-tests
	@$(BIN)/python tests/helpers/compile_kernels.py encoder
	@touch $@

checked: install
	@$(MAKE) --no-print-directory -j2 compiled-tests $(KERNELS) $(ENCODER)

# A test that hangs says where and fails, and the others go on.
test: checked $(BROWSER)
	$(BIN)/pytest -m 'not gpu and not long' -rs --durations=10 -o faulthandler_timeout=900 \
	  -o faulthandler_exit_on_timeout=true

test-fast: checked
	$(BIN)/pytest

test-long: install
	$(BIN)/pytest -m long

validate: install
	$(BIN)/python -m studies.laws --out studies/results

bench: install
	$(BIN)/python -m studies.speed

gpu-report: install
	$(BIN)/python -m studies.speed.card --out gpu-report.md

$(DOCS): $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	@touch $@

docs: $(DOCS)
	$(BIN)/python tools/write_reference.py
	$(BIN)/python tools/build_site.py --out build/site

clean:
	rm -rf build/site datasets/quickstart $(BROWSER) $(KERNELS) $(ENCODER) .pytest_cache .mypy_cache .ruff_cache
