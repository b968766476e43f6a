"""The import contracts detect direct and indirect violations."""

import re
import shutil
import subprocess
import sys

import pytest

from support.paths import ROOT

LINTER = "import sys; from importlinter.cli import lint_imports_command; sys.exit(lint_imports_command())"
FIRST_LINE = "from __future__ import annotations\n"


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """Copy the checked packages once for all tests."""
    folder = tmp_path_factory.mktemp("checkout")
    for program in ("firmware_py", "hil"):
        shutil.copytree(ROOT / program, folder / program, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def broken_contracts(folder):
    """Return the names of the broken contracts."""
    process = subprocess.run(
        [sys.executable, "-c", LINTER, "--no-cache"],
        cwd=folder,
        env={"PYTHONPATH": str(folder), "PATH": "", "COLUMNS": "400", "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert "Contracts:" in process.stdout, process.stdout + process.stderr
    return re.findall(r"^(.+) BROKEN\b", process.stdout, re.MULTILINE)


def test_import_contracts_are_kept(checkout):
    assert broken_contracts(checkout) == []


VIOLATIONS = [
    ("firmware_py/common/angles.py", "import time", "What computes reaches no file"),
    ("firmware_py/control/law.py", "from firmware_py.estimate import heading_filter", "The flow of the firmware"),
    ("firmware_py/common/angles.py", "from firmware_py.modes import decide", "The flow of the firmware"),
    ("firmware_py/sensors/nmea_framing.py", "from firmware_py.link import peer", "The flow of the firmware"),
    ("firmware_py/sensors/ubx.py", "import serial", "Drivers read no clock"),
    ("firmware_py/common/records.py", "from hil import errors", "The onboard part"),
    ("hil/devices/volz.py", "from firmware_py.actuator import volz_frames", "Emulators and ship share no codec"),
    ("hil/sim/world.py", "from firmware_py.core import step", "The harness knows formats"),
    ("hil/lab/similarity.py", "from firmware_py.control import law", "The harness knows formats"),
    ("hil/lab/estimate/boat.py", "from firmware_py.core import state", "The harness knows formats"),
    ("firmware_py/newroom/__init__.py", "", "The flow of the firmware"),
]


def add_line(folder, file, line):
    """Add a line to a new or existing module; return a function that removes it."""
    path = folder / file
    previous = path.read_text() if path.exists() else None
    path.parent.mkdir(exist_ok=True)
    path.write_text((previous or FIRST_LINE).replace(FIRST_LINE, f"{FIRST_LINE}\n{line}\n", 1))
    return lambda: shutil.rmtree(path.parent) if previous is None else path.write_text(previous)


def test_all_violations_together_are_detected(checkout):
    removals = [add_line(checkout, file, line) for file, line, _ in VIOLATIONS]
    try:
        names = broken_contracts(checkout)
    finally:
        for remove in reversed(removals):
            remove()
    assert [contract for *_, contract in VIOLATIONS if not any(name.startswith(contract) for name in names)] == []


@pytest.mark.proof
@pytest.mark.parametrize(("file", "line", "contract"), VIOLATIONS)
def test_single_violation_is_detected(checkout, file, line, contract):
    remove = add_line(checkout, file, line)
    try:
        assert any(name.startswith(contract) for name in broken_contracts(checkout))
    finally:
        remove()
