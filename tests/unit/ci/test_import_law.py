"""The import contracts detect direct and indirect violations."""

import re
import shutil
import subprocess
import sys

import pytest

from support.paths import ROOT

CALL = "import sys; from importlinter.cli import lint_imports_command; sys.exit(lint_imports_command())"
HERE = "from __future__ import annotations\n"


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """Copy the checked packages once for all tests."""
    folder = tmp_path_factory.mktemp("checkout")
    for program in ("firmware_py", "hil"):
        shutil.copytree(ROOT / program, folder / program, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def broken(folder):
    """Return the names of the broken contracts."""
    done = subprocess.run(
        [sys.executable, "-c", CALL, "--no-cache"],
        cwd=folder,
        env={"PYTHONPATH": str(folder), "PATH": "", "COLUMNS": "400", "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert "Contracts:" in done.stdout, done.stdout + done.stderr
    return re.findall(r"^(.+) BROKEN\b", done.stdout, re.MULTILINE)


def test_import_contracts_hold(checkout):
    assert broken(checkout) == []


LINES = [
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


def add(folder, file, line):
    """Add a line to a new or existing module; return a function that removes it."""
    path = folder / file
    before = path.read_text() if path.exists() else None
    path.parent.mkdir(exist_ok=True)
    path.write_text((before or HERE).replace(HERE, f"{HERE}\n{line}\n", 1))
    return lambda: shutil.rmtree(path.parent) if before is None else path.write_text(before)


def test_each_contract_can_be_broken(checkout):
    undo = [add(checkout, file, line) for file, line, _ in LINES]
    try:
        names = broken(checkout)
    finally:
        for take_back in reversed(undo):
            take_back()
    assert [contract for *_, contract in LINES if not any(name.startswith(contract) for name in names)] == []


@pytest.mark.proof
@pytest.mark.parametrize(("file", "line", "contract"), LINES)
def test_forbidden_import_is_refused(checkout, file, line, contract):
    take_back = add(checkout, file, line)
    try:
        assert any(name.startswith(contract) for name in broken(checkout))
    finally:
        take_back()
