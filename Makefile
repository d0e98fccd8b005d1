# Everything here needs Python 3.11 to 3.14 with venv, and make. Each target does its own set-up in .venv, which keeps
# the Python that it was made with; `make test PYTHONS=python3.13` makes it anew with another, and
# `make quick PYTHONS=python3.13 VENV=build/python3.13` leaves it alone.

PYTHONS := python3 python3.14 python3.13 python3.12 python3.11
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DEMO := $(VENV)/.installed-demo
DOCS := $(VENV)/.installed-docs
CLIENTS := build/clients
SERIAL := $(patsubst %,tests/live/test_%.py,dashboard_browser check_process ground_station)
REAL_CLOCKS := tests/live tests/firmware/test_processes.py tests/firmware/test_clients_firmware.py
PIP := python -m pip install --quiet --disable-pip-version-check --no-deps
INSTALL := $(BIN)/$(PIP)
COMPILE := uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate

# Some containers set it; then each of the hundreds of processes that tests start compiles every source again.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo quick test virtual live hunt check coverage clients docs wheel release lock clean

help:  ## list what there is
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1	\2/p' Makefile | expand -t 18

demo: $(DEMO)  ## dives in the simulator, half a minute; leaves out/demo.png and out/demo.json
	$(BIN)/holdfast demo

test: $(STAMP)  ## everything that must hold, `make check` included
	@$(MAKE) --no-print-directory --jobs --output-sync virtual live

virtual: $(STAMP) clients
	nice -n 19 $(BIN)/pytest -n auto --dist worksteal $(REAL_CLOCKS:%=--ignore %)

live: check clients
	$(BIN)/pytest $(REAL_CLOCKS) $(SERIAL:%=--ignore %) -n 2 --dist worksteal  # they mostly wait
	$(BIN)/pytest $(SERIAL)  # their dives want a core

quick: $(STAMP)  ## unit and property tests, without those that compile: about a minute
	$(BIN)/pytest -n auto --dist worksteal --hypothesis-profile quick -m 'not compiles' tests/unit tests/property

hunt: $(STAMP)  ## look for new examples of what must hold for any input; takes hours
	@$(BIN)/python -m tests.tools.fuzz_engine --ticks 1000000 --jobs $$(nproc) --first $$(date +%s); fuzzed=$$?; \
	$(BIN)/pytest -n auto --dist worksteal -m hypothesis --hypothesis-profile hunt --timeout 0 tests/unit \
	    tests/property && [ $$fuzzed = 0 ] || { \
	    echo '`python -m tests.tools.fuzz_engine --first N --dives 1` repeats dive N: mend the fault.'; \
	    echo 'What pytest found: put the "Falsifying example" above its test as @example(...),'; \
	    echo 'see that the test fails without --hypothesis-profile, and then mend the fault.'; \
	    exit 1; }

check: $(STAMP)  ## style, types, which package imports which, and the size of each
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/python -m tests.tools.budget

coverage: $(STAMP)  ## which branches of companion/ the tests in virtual time take; a floor stands in pyproject.toml
	$(BIN)/pytest -n auto --dist worksteal $(REAL_CLOCKS:%=--ignore %) --cov

clients: $(CLIENTS)/.installed  ## MAVProxy, which tests/live connects to the simulator

docs: $(DOCS)  ## the documents as a site, build/site/index.html; a broken link is an error
	$(BIN)/sphinx-build -nW --keep-going -q docs build/site

wheel: $(STAMP)  ## build dist/*.whl, try it in a venv of its own, and there without what extras bring
	rm -rf dist build/wheel
	$(BIN)/python -m hatchling build -t wheel
	$(BIN)/python -m venv build/wheel
	build/wheel/bin/$(PIP) --require-hashes --only-binary :all: -r requirements/vehicle.lock
	build/wheel/bin/$(PIP) dist/*.whl
	build/wheel/bin/holdfast --help
	build/wheel/bin/python -m pip uninstall --quiet --yes aiohttp mcap rich  # what extras bring
	build/wheel/bin/holdfast watch --once 2>&1 | grep -F "pip install 'holdfast-rov[dashboard]'"
	timeout --preserve-status -s INT 3 build/wheel/bin/holdfast run \
	    --set link.endpoint=udp-connect:127.0.0.1:14599 --set telemetry.endpoint=tcp/127.0.0.1:7459

release: wheel  ## dist/holdfast-VERSION.tar.gz: wheel, lock, image (where Docker has buildx), checksums; its install
	@set -e; version=$$(sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml); folder=dist/holdfast-$$version; \
	mkdir $$folder; cp dist/*.whl requirements/vehicle.lock .ci/install LICENSE $$folder; \
	if docker buildx version >/dev/null 2>&1; then \
	    docker buildx build --platform linux/arm/v7,linux/arm64,linux/amd64 --file blueos/Dockerfile \
	        --output type=oci,dest=$$folder/holdfast-blueos-$$version.tar .; \
	else echo 'No image: docker buildx is not here.' >&2; fi; \
	(cd $$folder && sha256sum -- * > SHA256SUMS); tar -C dist -czf $$folder.tar.gz holdfast-$$version; \
	(cd dist && sha256sum holdfast-$$version.tar.gz | tee holdfast-$$version.tar.gz.sha256)

lock:  ## refresh what is missing in the locks, of all platforms, with hashes (needs uv)
	$(COMPILE) pyproject.toml --extra dev -o requirements/dev.lock
	$(COMPILE) pyproject.toml --extra dashboard -c requirements/dev.lock -o requirements/vehicle.lock
	printf '%s\n' 'hatchling>=1.27' 'editables>=0.5' | \
	    $(COMPILE) pyproject.toml - --extra demo -c requirements/dev.lock -o requirements/demo.lock
	$(COMPILE) pyproject.toml --extra docs -c requirements/dev.lock -o requirements/docs.lock
	printf '%s\n' mavproxy pyserial | $(COMPILE) --no-deps - -o requirements/clients.lock

clean:  ## remove .venv, caches and out/
	rm -rf .venv out build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache .coverage
	find . -name __pycache__ -prune -exec rm -rf {} +

# Without what MAVProxy needs for a screen, such as VTK and OpenCV; pymavlink and numpy are those of .venv.
$(CLIENTS)/.installed: requirements/clients.lock $(STAMP)
	rm -rf $(CLIENTS)
	$(INSTALL) --no-compile --require-hashes --only-binary :all: --target $(CLIENTS) -r requirements/clients.lock
	@touch $@

# What a pilot needs; `make test` adds the tools of development to the same .venv.
$(DEMO): $(VENV)/pyvenv.cfg pyproject.toml requirements/demo.lock
	$(call set_up,requirements/demo.lock)
	@touch $@

$(STAMP): $(VENV)/pyvenv.cfg pyproject.toml requirements/dev.lock
	$(call set_up,requirements/dev.lock)
	@touch $@ $(DEMO)

$(DOCS): $(STAMP) requirements/docs.lock
	$(INSTALL) --require-hashes --only-binary :all: -r requirements/docs.lock
	@touch $@

# The interpreter behind the first fitting one of some Pythons, which may be those of venvs.
FITTING := import os, sys, venv, ensurepip; \
    (3, 11) <= sys.version_info[:2] <= (3, 14) or sys.exit(1); \
    print(os.path.realpath(sys._base_executable))
fitting = $(shell for name in $(1); do $$name -c '$(FITTING)' 2>/dev/null && break; done)

# .venv is made anew where its Python has gone or changed, or PYTHONS= asks for another one.
FOUND := $(call fitting,$(BIN)/python)
ASKED := $(if $(filter command%,$(origin PYTHONS)),$(call fitting,$(PYTHONS)),$(FOUND))
ifneq ($(shell sed -n "s/^executable = //p" $(VENV)/pyvenv.cfg 2>/dev/null) $(ASKED),$(FOUND) $(FOUND))
.PHONY: $(VENV)/pyvenv.cfg
endif
$(VENV)/pyvenv.cfg:
	@python='$(call fitting,$(PYTHONS))'; \
	if [ -z "$$python" ]; then \
	    echo 'Holdfast needs Python 3.11 to 3.14 with venv; for newer ones numba and others have no files yet.' >&2; \
	    for name in $(PYTHONS); do echo "$$name: $$($$name --version 2>&1)" >&2; done; \
	    echo 'On Debian or Ubuntu: sudo apt-get install python3-venv' >&2; \
	    exit 1; \
	fi; \
	echo "Setting up $(VENV) with $$python; the first time takes a minute."; \
	"$$python" -m venv --clear $(VENV)

define set_up
	$(INSTALL) --no-compile --require-hashes --only-binary :all: -r $(1)
	@$(BIN)/python -m pip uninstall --quiet --quiet --yes holdfast  # our name once: it has the same command
	$(INSTALL) --no-build-isolation -e .
endef
