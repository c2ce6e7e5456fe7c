# On a fresh Debian or Ubuntu, without ROS and without a virtual environment: make demo
#
# ROS 2 comes from PyPI wheels into .venv, unless a sourced ROS offers rclpy already.

# Another interpreter: make demo PYTHON=python3.12
PYTHON ?= python3
# Other wheels than those of setup.py's DEFAULT_DISTRIBUTION: make demo DISTRO=kilted
DISTRO ?=
VENV ?= .venv
BIN := $(VENV)/bin
# For example: make test PYTEST_ARGS='test/bag -x'
PYTEST_ARGS ?=
# Some of the combinations of .ci/matrix: make test-matrix MATRIX='jazzy-3.12-newest'
MATRIX ?=
# Three workers for two cores: a test with processes waits half of the time. A fourth makes it
# slower: nodes that wait for each other look around more often than they work.
PYTEST := $(BIN)/python -m pytest -n 3 --dist loadfile
# Else Numba counts what it compiles as run, and counts nothing where it finds it in its cache.
COVERAGE := NUMBA_JIT_COVERAGE=0
# Before Python 3.12 a test of Python steps takes more than twice the time when it is measured.
MEASURE = $(shell $(BIN)/python -c 'import sys; print("--cov" * (sys.version_info >= (3, 12)))')
# It interrupts a process after 50 ms; one that is measured is still importing coverage then.
NOT_MEASURED := test/live/test_stop.py::test_ctrl_c_at_any_moment_of_the_start_leaves_nothing_behind[0.05]

# Else each of the hundreds of processes that tests start compiles the package anew.
unexport PYTHONDONTWRITEBYTECODE

# A second call finds the stamp and is instant; another ROS has another stamp.
ROS := $(or $(DISTRO),default)-$(or $(ROS_DISTRO),wheels)
DEMO_READY := $(VENV)/.stamp-demo-$(ROS)
DOCS_READY := $(VENV)/.stamp-docs-$(ROS)
IMAGE_READY := $(VENV)/.stamp-image-$(ROS)
TEST_READY := $(VENV)/.stamp-test-$(ROS)
METADATA := setup.py setup.cfg .ci/setup-venv
SETUP_VENV = @DISTRO='$(DISTRO)' bash .ci/setup-venv $(PYTHON) $(VENV)
# On a machine that no ROS 2 is to be had for, the same plan offline: setup-venv leaves word of it.
RUN = $(if $(shell ls $(VENV)/.no-ros 2> /dev/null),simulate,run)
TELL = @cat $(VENV)/.no-ros 2> /dev/null || true

.DEFAULT_GOAL := help
.PHONY: help demo paper beyond image bench test test-slow test-matrix coverage lint docs outputs \
	screenshots clean

help:  ## this list
	@sed -nE 's/^([a-z-]+):.*## (.*)/make \1|\2/p' Makefile | awk -F'|' '{printf "  %-18s%s\n", $$1, $$2}'

demo: $(DEMO_READY)  ## set up .venv, drive the simulated rig through ROS, report into out/demo
	$(TELL)
	$(BIN)/piezo $(RUN) config/experiments/demo.yaml -o out/demo --force

paper: $(DEMO_READY)  ## every table and figure of the paper from live runs, into out/paper
	$(TELL)
	$(BIN)/piezo $(RUN) config/experiments/paper.yaml -o out/paper --force

beyond: $(DEMO_READY)  ## Table 4 planned and learned at the limits of the amplifier, into out/beyond
	$(TELL)
	$(BIN)/piezo $(RUN) config/experiments/beyond.yaml -o out/beyond --force

image: $(IMAGE_READY)  ## raster scans, published, planned, learned: images and their errors, into out/image
	$(TELL)
	$(BIN)/piezo $(RUN) config/experiments/raster.yaml -o out/image --force $(if $(filter run,$(RUN)),--composed)

bench: $(DEMO_READY)  ## measure this machine into docs/bench, several minutes; it should do nothing else
	mkdir -p docs/bench
	$(BIN)/python -m benchmarks --json docs/bench/reference.json
	$(BIN)/python -m benchmarks --draw docs/bench/reference.json -o docs/bench/reference.svg
	$(BIN)/python -m benchmarks.response_peers

test: $(TEST_READY)  ## style, types, tiers (test_lint.py), all other tests but the slow ones; coverage
	$(TELL)
	$(COVERAGE) $(PYTEST) $(if $(MEASURE),$(MEASURE) --cov-report=) $(PYTEST_ARGS)
	@if [ -n '$(MEASURE)' ]; then \
		echo "Lines of piezo_ros/ that these tests ran, with some of the processes that they started:" \
			"$$($(BIN)/coverage report --format=total) %"; \
	else echo 'Coverage is measured here from Python 3.12 on, by make coverage on any.'; fi

test-slow: $(TEST_READY) $(DOCS_READY)  ## the tests marked slow: long ones, and more cases of what quick tests check
	$(PYTEST) -m slow $(PYTEST_ARGS)

test-matrix:  ## all tests on Jazzy and Kilted, Python 3.10 and 3.12, newest and oldest versions: hours
	@bash .ci/matrix $(MATRIX) -- $(PYTEST_ARGS)

coverage: $(TEST_READY)  ## file by file, with the processes that tests start; slower
	$(TELL)
	$(COVERAGE) COVERAGE_PATCH=subprocess $(PYTEST) --cov --cov-report=term:skip-covered \
		--deselect '$(NOT_MEASURED)' $(PYTEST_ARGS)

lint: $(TEST_READY)  ## style, types and tiers alone
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(DOCS_READY)  ## the documentation as a site, docs/_build/html; prints parameters.md and launch.md
	$(BIN)/python -m piezo_ros.reference_pages docs
	rm -rf docs/_build docs/generated
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build/html

outputs: $(DEMO_READY)  ## print what docs/your-own-stage.md shows, by the commands that it names
	$(BIN)/python test/support/printed_outputs.py

screenshots: $(TEST_READY)  ## every page below out/ as seen light, dark, on a phone, printed
	$(BIN)/python test/support/screenshots.py out -o out/screenshots

clean:  ## remove .venv and .matrix, what was built and what tools cached; out/ stays
	rm -rf $(VENV) .matrix build dist install log *.egg-info docs/_build docs/generated
	rm -rf .coverage .coverage.* .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find $(wildcard piezo_ros benchmarks launch test) -name __pycache__ -prune -exec rm -rf {} +

$(DEMO_READY): $(METADATA)
	$(SETUP_VENV)
	@touch $@

$(DOCS_READY): $(METADATA)
	$(SETUP_VENV) docs
	@touch $@ $(DEMO_READY)

$(IMAGE_READY): $(METADATA)
	$(SETUP_VENV) images
	@touch $@ $(DEMO_READY)

$(TEST_READY): $(METADATA)
	$(SETUP_VENV) test,ni
	@touch $@ $(DEMO_READY)
