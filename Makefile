# Two commands: `make demo` runs the main job, `make test` the tests. Both set up .venv first.
PYTHON ?= python3
VENV := .venv
ifeq ($(OS),Windows_NT)
BIN := $(VENV)/Scripts
else
BIN := $(VENV)/bin
endif
PIP := $(BIN)/python -m pip --disable-pip-version-check --no-input

# Distribute whole files, in the order of tests/conftest.py. Three processes on two cores: many tests wait for a clock.
PROCESSES := -n 3 --dist loadfile --no-loadscope-reorder

# For the tests of the real vehicle: a compiler and an emulator of its microcontroller, and emulated devices. For the
# tests of the page: a browser.
DEBIAN := gcc gcc-avr binutils-avr avr-libc libsimavr-dev libelf-dev avrdude arduino-core-avr umockdev \
          gir1.2-umockdev-1.0 libumockdev-dev python3-gi i2c-tools chromium
AARCH64 := qemu-user-static mmdebstrap gcc-aarch64-linux-gnu libc6-dev-arm64-cross

.PHONY: demo test test-all test-fast browser-tools fuzz docs promises golden catalogues test-emulated aarch64 firmware debian lint bench lock wheel clean

demo: $(VENV)/run.stamp
	$(BIN)/baqueano demo

test: $(VENV)/test.stamp debian browser-tools
	$(BIN)/python -m pytest $(PROCESSES)

# Also run the studies, tutorials and benchmarks that `make test` skips by name; this takes a third longer.
test-all: $(VENV)/test.stamp debian browser-tools
	BAQUEANO_LONG=1 $(BIN)/python -m pytest $(PROCESSES)

# Run the quick tests of blocks, runs and engine, in about a minute on two cores; tests/conftest.py lists the slow ones.
test-fast: $(VENV)/test.stamp
	$(BIN)/python -m pytest $(PROCESSES) -m "not slow"

# Install the npm packages of the tests of the page, by a lock with hashes: the public client of Foxglove's protocol and
# the rules of axe-core. Without npm those tests are skipped by name; in CI they fail.
browser-tools:
	@if command -v npm >/dev/null; then for one in foxglove axe; do \
	  npm ci --silent --ignore-scripts --no-audit --no-fund --prefix tests/web/$$one || [ -z "$$CI" ] || exit 1; done; fi

# Build the site of docs/ in two languages, build/site/index.html, which is read without a network.
docs: $(VENV)/test.stamp
	$(BIN)/python -m docs.site

# Read 20,000 damaged inputs of each external format; `make test` reads them for 20 s, and CI reads all.
fuzz: $(VENV)/test.stamp
	BAQUEANO_FUZZ=20000 $(BIN)/python -m pytest -s $(PROCESSES) tests/fuzz/test_fuzz.py

# List the promises of the package, and the tests of each.
promises: $(VENV)/test.stamp debian
	BAQUEANO_LONG=1 $(BIN)/python -m tests.promises $(PROCESSES)

# Write the pages on the keys of a vehicle file, and show the diff.
golden: $(VENV)/test.stamp
	REGENERATE=1 $(BIN)/python -m pytest -q tests/test_docs.py -k reference_of_the_vehicle_file
	git diff --stat docs

# Write the catalogues of all sentences, and list those that need a translation.
catalogues: $(VENV)/test.stamp
	$(BIN)/python -m tests.catalogues

# As in CI, a missing emulator is a failure, not a skip.
test-emulated: $(VENV)/test.stamp debian
	CI=1 $(BIN)/python -m pytest $(PROCESSES) tests/emulated

# Test the service on the instruction set of a Pi 3, under qemu. It needs 170 MB of downloads and 0.75 GB of disk,
# so CI does not run it.
aarch64: $(VENV)/test.stamp debian
	@dpkg -s $(AARCH64) >/dev/null 2>&1 || { echo "First: sudo apt-get install --no-install-recommends $(AARCH64)"; exit 2; }
	$(BIN)/python -m tests.emulated.aarch64
	$(BIN)/python -m pytest -s tests/emulated/test_aarch64.py

firmware: $(VENV)/run.stamp
	$(BIN)/python firmware/uno/c_header.py > firmware/uno/frames.h
	$(MAKE) -C firmware/uno
	cp build/firmware/uno.hex src/baqueano/robot/files/uno.hex

# Install as root, and in CI with sudo; elsewhere print the command to type, and those tests are skipped by name.
debian:
	@dpkg -s $(DEBIAN) >/dev/null 2>&1 && exit 0; \
	if ! command -v apt-get >/dev/null; then echo "No apt-get here: tests that need an emulated robot are skipped."; exit 0; fi; \
	if [ "$$(id -u)" = 0 ]; then as=; elif [ -n "$$CI" ] && sudo -n true 2>/dev/null; then as=sudo; else \
	  echo "For the tests of the emulated robot: sudo apt-get install --no-install-recommends $(DEBIAN)"; exit 0; fi; \
	echo "Installing $(DEBIAN)"; \
	{ $$as apt-get update -q && $$as env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends $(DEBIAN); } \
	  >/dev/null || echo "Some packages were not installed: tests that need them are skipped, or fail where CI is set."

lint: $(VENV)/test.stamp
	$(BIN)/pre-commit run --all-files

bench: $(VENV)/test.stamp
	$(BIN)/python -m benchmarks

wheel: $(VENV)/test.stamp
	$(BIN)/python -m build --no-isolation --wheel

lock:
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
	  --custom-compile-command "make lock" --extra lab --extra page pyproject.toml requirements/build.in -o requirements/run.lock
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
	  --custom-compile-command "make lock" --extra lab --extra page --extra test --extra docs pyproject.toml requirements/build.in -o requirements/test.lock
	$(BIN)/uv pip compile --quiet --python-version 3.11 --python-platform aarch64-manylinux_2_31 --generate-hashes \
	  --no-emit-index-url --no-annotate --no-header requirements/onboard.in -o src/baqueano/robot/files/onboard.lock
	sed -i '1i # make lock: the packages of a vehicle'"'"'s computer, each with the hashes of all its wheels.' \
	  src/baqueano/robot/files/onboard.lock

clean:
	rm -rf $(VENV) dist build demo demo-*

$(VENV)/created.stamp:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "baqueano needs Python 3.11 or newer; '$(PYTHON)' is older or missing. Try: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 2; }
	@$(PYTHON) -m venv $(VENV) || \
	  { echo "Python could not make $(VENV). On Debian and Ubuntu: sudo apt-get install python3-venv"; exit 2; }
	@touch $@

$(VENV)/run.stamp: $(VENV)/created.stamp requirements/run.lock pyproject.toml
	$(PIP) install --quiet --require-hashes -r requirements/run.lock
	$(PIP) install --quiet --no-deps --no-build-isolation -e .
	@touch $@

$(VENV)/test.stamp: $(VENV)/created.stamp requirements/test.lock pyproject.toml
	$(PIP) install --quiet --require-hashes -r requirements/test.lock
	$(PIP) install --quiet --no-deps --no-build-isolation -e .
	@touch $@ $(VENV)/run.stamp
