# `make sail` shows her holding a heading; `make test` runs the whole test suite.
# Both set up .venv first; nothing but git, make and Python 3.11 with venv is needed.

PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: help sail test lint types pages pages-check docs bench proof lock clean

help:
	@echo "make sail   a heading run in the tank, live in the terminal, MAVLink on udp 14550"
	@echo "make test   the whole test suite"
	@echo "make lint types pages-check   what CI checks besides"
	@echo "make pages  write the generated pages anew"
	@echo "make docs   the documentation, into docs/_build/html"
	@echo "make bench  lateness, latency, load, memory, round trips and the speed of the tools on this machine"
	@echo "make proof  the longer proofs: seas, stations, identification, lossy links, floods; some hours"

# The venv is made anew when the dependencies change. Pythons under other names are tried so
# that a newer one serves too.
$(READY): pyproject.toml .ci/constraints.txt
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) is not here; name another: make PYTHON=python3.12 ..." >&2; exit 2; }
	@echo "setting up $(VENV) (once; a minute or two)"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c .ci/constraints.txt -e '.[dev]'
	@echo '*' > $(VENV)/.gitignore
	@touch $(READY)

sail: $(READY)
	@$(BIN)/rambler-hil run tank --speed 15 --goal "0:0,120:60,480:-90" --seconds 840 \
	  --link udpout:127.0.0.1:14550 --link tcpin:127.0.0.1:5760

# More workers than the machine has cores: many tests wait for programs that they have started.
test: $(READY)
	$(BIN)/python -m pytest -n 4 --dist worksteal

lint: $(READY)
	$(BIN)/ruff check firmware_py hil tests docs
	$(BIN)/ruff format --check firmware_py hil tests docs

types: $(READY)
	$(BIN)/mypy

# page | command that prints it
pages: $(READY)
	$(BIN)/rambler params --markdown > params/REFERENCE.md
	$(BIN)/rambler params --faults > params/FAULTS.md
	$(BIN)/rambler params --messages > params/MESSAGES.md

pages-check: $(READY)
	$(BIN)/rambler params --markdown | diff -u params/REFERENCE.md -
	$(BIN)/rambler params --faults | diff -u params/FAULTS.md -
	$(BIN)/rambler params --messages | diff -u params/MESSAGES.md -

$(VENV)/.docs-ready: $(READY)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c .ci/constraints.txt -e '.[docs]'
	@touch $@

docs: $(VENV)/.docs-ready
	$(BIN)/python -m sphinx -b html -W --keep-going -q docs docs/_build/html
	@echo "docs/_build/html/index.html"

bench: $(READY)
	@$(BIN)/rambler-hil bench

proof: $(READY)
	$(BIN)/python -m pytest -m proof -n 2

# After a change of dependencies: writes what is installed as the constraints of all installs.
lock: $(READY)
	$(BIN)/python -m pip freeze --exclude-editable | grep -v '^-e' > .ci/constraints.txt

clean:
	rm -rf $(VENV) runs docs/_build .mypy_cache .ruff_cache .hypothesis
