# The two commands of a fresh machine are `make sim` and `make test`; they need Python 3.11 to 3.13 and nothing else.
PYTHON ?= python3
VENV ?= .venv
RUN := $(VENV)/bin/python
PIP := $(RUN) -m pip install --quiet --disable-pip-version-check --no-input
# Nothing but the wheels whose digests the lock files know: a source distribution would fetch build tools without any.
LOCKED := $(PIP) --require-hashes --only-binary=:all:
DURATION ?= 20
OUT ?= build/figures
BOARD ?= host
CONTAINER ?= docker
SPHINX := $(RUN) -m sphinx --fail-on-warning --keep-going --quiet

# Installing on a Raspberry Pi: sudo make install [LAMP_GPIO=23|none] [PICAMERA2=1]; into a folder: DESTDIR=/tmp/root
DESTDIR ?=
LAMP_GPIO ?= 18
INSTALL_FLAGS := --root "$(DESTDIR)/" $(if $(DRY_RUN),--dry-run)

.DEFAULT_GOAL := help
.PHONY: help sim sim-web test proof lint docs figures wheel install uninstall firmware container lock wheels licences audit check-pi clean

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 20

sim: $(VENV)/.runtime ## run the daemon against the simulated rig (DURATION=20; the first time some minutes, to install)
	$(VENV)/bin/hoopd --sim --duration $(DURATION)

sim-web: $(VENV)/.runtime ## the rig with the web page beside it; prints the page's address (ARGS="--listen 127.0.0.1:8765")
	$(RUN) tools/sim_web.py $(ARGS)

test: $(VENV)/.development ## run the tests, some ten minutes on two cores, twice that on slow ones (ARGS="-k name"; the long proofs: make proof)
	$(RUN) tools/suite.py $(ARGS)

proof: $(VENV)/.development ## the long proofs, many seeds each, some fifteen minutes (ARGS="-k name")
	$(RUN) tools/suite.py --proof $(ARGS)

lint: $(VENV)/.development ## style, types and import contracts
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy
	$(RUN) -m mypy --config-file tools/mypy.ini
	$(VENV)/bin/lint-imports

figures: $(VENV)/.runtime ## draw the thesis's figures again (OUT=build/figures, ONLY=name; HOOPD_SHARED=folder of recordings/)
	$(RUN) tools/figures.py --out $(OUT) $(addprefix --only ,$(ONLY))

docs: $(VENV)/.development ## the documentation as a site; a link that leads nowhere fails (build/docs/index.html)
	$(SPHINX) docs build/docs

wheel: $(VENV)/.runtime ## what `pip install .` installs, as a file in dist/, and what is in it
	$(RUN) tools/wheel.py

install: ## install on this Raspberry Pi (as root)
	$(PYTHON) tools/install.py install $(INSTALL_FLAGS) --lamp-gpio $(LAMP_GPIO) $(if $(PICAMERA2),--picamera2)

uninstall: ## take it away again; recordings and configuration stay (PURGE=1: not even those)
	$(PYTHON) tools/install.py uninstall $(INSTALL_FLAGS) $(if $(PURGE),--purge)

firmware: ## the driver board's firmware as a program for the rig (BOARD=stm32f4: for a microcontroller)
	$(MAKE) --no-print-directory -C tools/firmware $(BOARD) OUT=$(CURDIR)/build/firmware

container: ## the rig and its web page as an image (CONTAINER=podman)
	$(CONTAINER) build -t hoopd -f tools/container/Containerfile .

lock: ## newest versions that fit into the lock files, with digests (PYTHON=python3.11; KEEP=1: versions stay)
	$(PYTHON) tools/lock.py $(if $(KEEP),--keep)

wheels: $(VENV)/.runtime ## has every pinned package wheels for the Raspberry Pi, and are they the locked ones?
	$(RUN) tools/check_wheels.py

licences: $(VENV)/.development ## licences of all dependencies; fails for one that is not permitted (pyproject.toml)
	$(RUN) tools/licences.py

audit: $(VENV)/.runtime ## known advisories about locked versions (AUDIT_DB=folder or zip of OSV files; skipped without)
	$(RUN) tools/audit.py $(AUDIT_DB)

check-pi: $(VENV)/.runtime ## arm64 by emulation and the service under a real systemd, a quarter of an hour (as root; ARGS=arm64 or systemd)
	$(RUN) tools/pi $(ARGS)

clean: ## remove the environment and everything that was built
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Stamps: a second call only installs when a lock file or pyproject.toml has changed. The checkout itself has no digest, pip
# knows none for a folder: it is installed without dependencies, by the locked build backend that is there already.
$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14) and "hoopd needs Python 3.11, 3.12 or 3.13, this is " + sys.version.split()[0] + " (make PYTHON=python3.11)")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.runtime: requirements.lock pyproject.toml | $(VENV)/bin/python
	$(LOCKED) -r requirements.lock
	$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@

$(VENV)/.development: requirements-dev.lock $(VENV)/.runtime
	$(LOCKED) -r requirements-dev.lock
	@touch $@
