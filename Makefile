# Two commands for newcomers:  make demo   renders a wall on a simulated drive and draws it
#                              make test   runs every test
# Before a commit:             make check  style, types, import contracts

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

# Debian packages beside Python. tshark: a foreign program reads what is recorded.
SYSTEM_PACKAGES := tshark

# PYTHON=/path/to/python chooses another interpreter than the first suitable one.
PYTHON ?= $(shell for python in python3 python3.13 python3.12 python3.11 python; do \
	if $$python -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
	command -v $$python; break; fi; done)

.PHONY: demo test check setup system-packages format clean

demo: setup
	$(BIN)/haptic-fieldbus run wall --drive maxon_epos4 --duration 10 --plot demo.png

# The gates come last and repeat how many tests passed and failed.
test: setup
	@mkdir -p build
	@$(BIN)/pytest -n 2 --dist loadgroup --cov --cov-report= --cov-report=json:build/coverage.json \
		--junit-xml=build/tests.xml; status=$$?; \
	$(BIN)/python tests/coverage_gates.py build/coverage.json build/tests.xml || exit 1; exit $$status

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

setup: system-packages $(STAMP)

$(STAMP): pyproject.toml
	@if [ -z "$(PYTHON)" ]; then \
		echo "No Python 3.11 or newer with venv was found. On Debian: apt-get install python3 python3-venv" >&2; exit 1; fi
	@echo "Installing into $(VENV), once; this takes about a minute"
	@[ -x $(BIN)/python ] || "$(PYTHON)" -m venv $(VENV)
	@echo "Installing into $(VENV), once; this takes about a minute"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[plot,dev]'
	@# What a first start would otherwise pay for: matplotlib's list of fonts, and our own byte code.
	@$(BIN)/python -c 'import matplotlib.font_manager' 2>/dev/null || true
	@$(BIN)/python -m compileall -q haptic_fieldbus
	@touch $@

system-packages:
	@missing=""; for package in $(SYSTEM_PACKAGES); do \
		dpkg-query -W -f='$${Status}' $$package 2>/dev/null | grep -q 'ok installed' || missing="$$missing $$package"; done; \
	[ -z "$$missing" ] && exit 0; \
	if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
		echo "Installing$$missing, once"; \
		{ apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends $$missing; } \
			>/dev/null || echo "Not installed:$$missing; tests that need them are skipped" >&2; \
	else echo "Missing system packages, tests that need them are skipped: apt-get install$$missing" >&2; fi

clean:
	rm -rf build dist demo.png .coverage* .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
