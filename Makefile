# Two commands for newcomers:  make demo      renders a wall on a simulated drive and draws it
#                              make test      the quick lane of the tests, and how much of the code they must cover
# Before a commit:             make check     style, types, import contracts
# After one thing is added:   make docs      pages, tables, schemas and pictures that follow from the code
# Before a release:            make test-all  every test
#                              make test-vendor   the tests that read vendors' EDS files
#                              make bench     speed, each figure beside a reference; fails above its bound
#                              make soak      ten thousand seeded faulty runs, and more, within 90 minutes

VENV := .venv
BIN := $(VENV)/bin
# What has been installed: what the demo needs, or all that developing needs.
DEMO_STAMP := $(VENV)/.demo
DEV_STAMP := $(VENV)/.dev

# Debian packages beside Python. tshark, mbpoll: foreign programs read what is recorded, and speak with a drive. gcc, libmodbus: a foreign server is
# compiled. User-Mode Linux (41 MB to fetch) and what works with it: SocketCAN where the kernel has none. Beyond the quick lane: buildah, images
# without a daemon; chromium and its driver, for the page of a run (122 MB to fetch).
SYSTEM_PACKAGES := mbpoll tshark gcc libc6-dev libmodbus-dev user-mode-linux kmod iproute2 can-utils
test-all test-part: SYSTEM_PACKAGES += buildah chromium chromium-driver fonts-liberation

# PYTHON=/path/to/python chooses another interpreter than the first suitable one; an environment of another version is
# made anew.
PYTHON ?= $(shell for python in python3 python3.13 python3.12 python3.11 python; do \
	if $$python -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
	command -v $$python; break; fi; done)

VERSION := -c 'import sys; print(sys.version)'
ifneq ($(origin PYTHON),file)
ifneq ($(shell asked=$$("$(PYTHON)" $(VERSION)) && used=$$($(BIN)/python $(VERSION) 2>/dev/null) && \
	[ "$$asked" != "$$used" ] && echo other),)
$(info $(VENV) is of another Python, and is made anew with $(PYTHON))
$(shell rm -rf $(VENV))
endif
endif

# Hundreds of processes are started; each would compile again what it imports.
export PYTHONDONTWRITEBYTECODE :=

PYTEST := $(BIN)/python -m pytest -n 2 --dist loadgroup
# Of the thorough lane, for `make test-part`.
PART ?= 0/1

.PHONY: demo test test-all test-part test-vendor soak bench check docs setup system-packages format clean

demo: $(DEMO_STAMP)
	$(BIN)/haptic-fieldbus run wall --drive maxon_epos4 --hand release --duration 3 --plot demo.png

# The gates come last and repeat how many tests passed and failed.
test: setup
	@$(PYTEST) --lane quick -p tests.tracing --coverage build/coverage.json --junit-xml=build/tests.xml; status=$$?; \
	$(BIN)/python tests/coverage_gates.py build/coverage.json build/tests.xml || exit 1; exit $$status

test-all: setup
	@$(PYTEST) --lane all --durations=20 --junit-xml=build/all.xml

# A share of what `make test` leaves out, as .ci/run takes it.
test-part: setup
	@$(PYTEST) --lane thorough --part $(PART) --junit-xml=build/part.xml

# With HAPTIC_FIELDBUS_VENDOR_FILES=/path/to/folder: EDS and DCF files of vendors, which may not be distributed.
test-vendor: setup
	@$(PYTEST) --lane vendor --junit-xml=build/vendor.xml

# Seeded faults, damaged frames and files, an hour of virtual time; SOAK_RUNS=100 is a small one. It goes on where it was
# ended.
SOAK_RUNS ?= 10000
# BENCH=--short for fewer rounds, BENCH=--write for the page.
bench: setup
	$(BIN)/python benchmarks/bench.py $(BENCH)

soak: setup
	@SOAK_RUNS=$(SOAK_RUNS) $(BIN)/python -m tests.soak

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# What is written from the code; a test says so where it is out of date. Golden texts are read by a person:
# `python -m tests.golden` writes those.
docs: setup
	$(BIN)/python docs/make_architecture.py
	$(BIN)/python docs/make_api.py
	$(BIN)/python docs/make_buses.py
	$(BIN)/python docs/make_elements.py
	$(BIN)/python docs/make_faults.py
	$(BIN)/python docs/make_figures.py
	$(BIN)/python docs/make_modbus_profiles.py
	$(BIN)/python docs/make_rig_files.py
	$(BIN)/python docs/make_tables.py
	$(BIN)/python -m haptic_fieldbus.schemas docs/reference/schemas --shipped

# The moving picture of the README, filmed in a headless Chromium; written again only where the page shows something else.
film: setup
	$(BIN)/python docs/make_live_view.py

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

setup: system-packages $(DEV_STAMP)

# The byte code of what the demo imports is written as it starts; compiling everything takes longer than the demo.
define install
	@if [ -z "$(PYTHON)" ]; then \
		echo "No Python 3.11 or newer with venv was found. On Debian: apt-get install python3 python3-venv" >&2; exit 1; fi
	@echo "Installing $(1) into $(VENV), once"
	@[ -x $(BIN)/python ] || "$(PYTHON)" -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[$(1)]'
endef

# With multicast, a bus between two terminals that needs nothing of the system.
$(DEMO_STAMP): pyproject.toml
	$(call install,plot$(,)multicast)
	@touch $@

$(DEV_STAMP): pyproject.toml
	$(call install,plot$(,)dev)
	@$(BIN)/python -m compileall -qq -j 0 $(VENV)/lib haptic_fieldbus || true
	@touch $(DEMO_STAMP) $@

# A comma inside an argument.
, := ,

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
