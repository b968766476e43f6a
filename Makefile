# `make sail` runs the simulated boat; `make test` runs the test suite. Each installs what it needs into .venv first.
# Needs git, make and a Python from 3.11 to 3.14 with venv, which .ci/find_python finds; make PYTHON=/path/to/python3.12
# selects another one.

PYTHON ?=
# Without bytecode files each process that a test starts would compile pymavlink, which takes seconds.
unexport PYTHONDONTWRITEBYTECODE
VENV := .venv
BIN := $(VENV)/bin
# Marks for what is installed: for simulated runs, for the tests, for the documentation.
VENV_READY := $(VENV)/.ready-venv
SAIL_READY := $(VENV)/.ready-sail
BUNDLE_READY := $(VENV)/.ready-bundle
READY := $(VENV)/.ready-test
DOCS_READY := $(VENV)/.ready-docs
FUZZ_READY := $(VENV)/.ready-fuzz
# --no-compile: few of the many modules are ever imported. It saves half the time and 140 MB.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c .ci/constraints.txt

ONBOARD_LOCK := .ci/requirements-onboard.txt
SUPPLY_READY := $(VENV)/.ready-supply
ONBOARD_VENV := build/onboard

.PHONY: help sail test fuzz lint types pages pages-check docs bench bench-kept bench-check proof lock bundle sbom audit clean

help:
	@echo "make sail   simulated run in the tank, live in the terminal and in a browser, MAVLink on udp 14550"
	@echo "make test   the test suite"
	@echo "make fuzz   ten minutes of random input for every reader: FUZZ_SECONDS, FUZZ=\"--seed 2 TARGET ...\""
	@echo "make lint types pages-check   other checks of CI"
	@echo "make pages  write the generated pages, and the generated parts of the others"
	@echo "make docs   documentation in docs/_build/html"
	@echo "make bench  latency, load, memory, start, transfers and the speed of the tools on this machine"
	@echo "make bundle  bundle that rambler update installs without a network: FOR=\"aarch64:3.13 ...\" SIGN=KEY"
	@echo "make sbom   bill of materials of the onboard computer, as CycloneDX, in build/sbom.json"
	@echo "make audit  known vulnerabilities of these packages; asks the Python package index"
	@echo "make bench-check  compare with the ratios kept in docs/figures.json; make bench-kept measures these again"
	@echo "make proof  long tests: seas, stations, identification, lossy links, floods; some hours"

# Repeated when the dependencies change. The times hold for two cores and a fast network.
$(VENV_READY):
	@python=$$(.ci/find_python "$(PYTHON)") && \
	  echo "setting up $(VENV) with $$("$$python" --version), once" && \
	  echo "  1/2 the virtual environment: about 4 s" && \
	  "$$python" -m venv $(VENV)
	@echo '*' > $(VENV)/.gitignore
	@touch $@

$(SAIL_READY): pyproject.toml .ci/constraints.txt | $(VENV_READY)
	@echo "  2/2 autopilot, simulator and their dependencies (numpy, pymavlink, matplotlib): about 10 s, 230 MB"
	@$(PIP) -e '.[sim]'
	@touch $@

$(READY): $(SAIL_READY)
	@echo "adding the packages for tests, once: about 30 s, 1.3 GB (numba, pytest, ruff, mypy; MAVSDK, and MAVProxy with OpenCV and VTK)"
	@$(PIP) -e '.[dev,clients]'
	@touch $@

sail: $(SAIL_READY)
	@echo "simulating 14 minutes in the tank at 15 times real time: about a minute; figures and report at the end"
	@$(BIN)/rambler-hil run tank --speed 15 --goal "0:0,120:60,480:-90" --seconds 840 --view \
	  --link udpout:127.0.0.1:14550 --link tcpin:127.0.0.1:5760

# More workers than cores: many tests wait for programs that they have started.
test: $(READY)
	@echo "running the tests: 6 to 10 minutes on two cores"
	$(BIN)/python -m pytest -n 3 --dist worksteal

$(FUZZ_READY): $(READY)
	@echo "adding atheris, once: 60 MB (x86-64 only; elsewhere the inputs change at random)"
	@$(PIP) -e '.[fuzz]'
	@touch $@

# All targets share the time, two at a time. The same seed gives the same inputs.
FUZZ_SECONDS ?= 600
fuzz: $(FUZZ_READY)
	@PYTHONPATH=.:tests PYTHONHASHSEED=0 $(BIN)/python -m fuzz --seconds $(FUZZ_SECONDS) $(FUZZ)

lint: $(READY)
	$(BIN)/python .ci/language.py
	$(BIN)/ruff check firmware_py hil tests docs .ci
	$(BIN)/ruff format --check firmware_py hil tests docs .ci
	$(BIN)/lint-imports --no-cache

types: $(READY)
	$(BIN)/mypy

# The generated pages, and the generated parts of pages: figures, tables, help texts, excerpts of code.
pages: $(READY)
	@$(BIN)/python docs/pages.py

pages-check: $(READY)
	@$(BIN)/python docs/pages.py --check

$(DOCS_READY): $(SAIL_READY)
	@echo "adding the packages for the documentation, once: about 5 s, 70 MB (Sphinx, furo, MyST)"
	@$(PIP) -e '.[docs]'
	@touch $@

docs: $(DOCS_READY)
	$(BIN)/python -m sphinx -b html -W --keep-going -q docs docs/_build/html
	@echo "docs/_build/html/index.html"

bench: $(READY)
	@$(BIN)/rambler-hil bench

# The measurements whose repeats are kept, and those that CI compares with them: the Python instructions of a tick, which
# are counted and therefore comparable on any machine, and the processor time and memory of separate processes.
# Measurements within the process of the bench depend on where its data lie in memory, so CI does not compare them.
BENCH_KEPT := --only work --only replay --only load --only start --only lockstep --only twin
BENCH_CHECKED := --only work --only replay --only load --only start
bench-kept: $(READY)
	$(BIN)/rambler-hil bench --quick $(BENCH_KEPT) --repeat 7 --figures docs/figures.json

bench-check: $(READY)
	$(BIN)/rambler-hil bench --quick $(BENCH_CHECKED) --against docs/figures.json

proof: $(READY)
	$(BIN)/python -m pytest -m proof -n 2

$(SUPPLY_READY): $(READY) $(DOCS_READY)
	@echo "adding the packages for lock, bill of materials and audit, once: about 10 s, 90 MB (uv, cyclonedx-bom, pip-audit)"
	@$(PIP) -e '.[supply]'
	@touch $@

# After a change of dependencies: writes the installed versions as constraints of all installs, and the onboard
# packages with the hashes of all their files, for every platform and Python.
lock: $(SUPPLY_READY)
	$(BIN)/python -m pip freeze --exclude-editable | grep -v -e '^-e' -e '^atheris=' > .ci/constraints.txt
	$(BIN)/uv pip compile pyproject.toml --quiet --no-config --universal --python-version 3.11 --generate-hashes \
	  --constraint .ci/constraints.txt --no-header --no-annotate --output-file $(ONBOARD_LOCK)

# .ci/bundle.py needs msgspec alone; pip fetches what is in the bundle.
$(BUNDLE_READY): .ci/constraints.txt | $(VENV_READY)
	@$(PIP) msgspec
	@touch $@

# The locked packages as wheels, with pip and a list of all hashes; for this computer, or those that FOR names. DRIVERS:
# wheels of driver packages of other authors, which bundle and bill of materials then contain.
FOR ?=
DRIVERS ?=
SIGN ?=
bundle: $(BUNDLE_READY)
	@$(BIN)/python .ci/bundle.py $(if $(FOR),--for $(FOR)) $(if $(DRIVERS),--drivers $(DRIVERS)) $(if $(SIGN),--sign $(SIGN))

# From an environment made of the lock alone, so that it lists only what the onboard computer has.
sbom: $(SUPPLY_READY)
	@rm -rf $(ONBOARD_VENV)
	@$(BIN)/python -m venv --without-pip $(ONBOARD_VENV)
	@$(BIN)/python -m pip --python $(ONBOARD_VENV)/bin/python install --quiet --disable-pip-version-check --no-compile \
	  --require-hashes -r $(ONBOARD_LOCK)
	@$(if $(DRIVERS),$(BIN)/python -m pip --python $(ONBOARD_VENV)/bin/python install --quiet --no-compile --no-deps $(DRIVERS))
	@$(BIN)/cyclonedx-py environment $(ONBOARD_VENV)/bin/python --pyproject pyproject.toml --mc-type firmware \
	  --output-reproducible --output-format JSON --output-file build/sbom.json
	@echo "build/sbom.json"

# A package that cannot be looked up is a failure.
audit: $(SUPPLY_READY)
	$(BIN)/pip-audit --strict --require-hashes --disable-pip -r $(ONBOARD_LOCK)

clean:
	rm -rf $(VENV) build runs docs/_build .mypy_cache .ruff_cache .hypothesis
