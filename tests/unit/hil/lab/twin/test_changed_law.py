"""A change of estimator or control law in firmware_py needs no change in hil: a modified copy is compiled."""

import os
import re
import shutil
import subprocess
import sys

import pytest

from support.paths import ROOT

# File, pattern and replacement: another term in the fixed-gain law, and constants of the law and of both filters.
CHANGES = (
    ("control/law.py", r"gains\.k1 \* error \+ ", "gains.k1 * error + 0.5 * error * error * error + "),
    ("control/law.py", r"(?<=^RATE_GAIN: Final = )[\d.]+", "0.45"),
    ("estimate/heading_model.py", r"(?<=^OUTLIER_SQUARE = )[\d.]+", "2.0"),
    ("estimate/heading_filter.py", r"(?<=^WINDOW_S = )[\d.]+", "10.0"),
    ("estimate/water.py", r"(?<=^SLOW_TIME_CONSTANT_S: Final = )[\d.]+", "20.0"),
)
FUNCTIONS = """
from hil.lab.compiled import compiled
from hil.lab.numeric_core import Gains, heading_model, law

gains, motion = Gains(8.0, 6.0, 0.5, 0.03, 0.0), heading_model.begin(0.0, heading_model.NoiseLevels())
for function, arguments in ((law.s_surface, (gains, 0.8, 0.01)), (heading_model.log_likelihood, (3.0, 1.0))):
    print(repr(function(*arguments)), repr(compiled(function)(*arguments)))
"""
LOOP = """
import hashlib
from firmware_py.common.parameters import ParameterSet
from hil.lab.numeric_core import LawSettings
from hil.lab.twin import sailing
from hil.lab.twin.sea import sea_of as drawn
from hil.ship.scenarios import parse_scenario
from hil.sim.goals import parse_goals

parameters = ParameterSet()
sea, task = drawn(parse_scenario("coast"), 1, 120.0), sailing.task_of(parse_goals("0:0,25:60"))
record, _ = sailing.sail(sailing.boat_of(parameters), LawSettings.of(parameters), sea, task, 120.0)
print(hashlib.sha256(record.rudder_rad.tobytes()).hexdigest())
"""


@pytest.fixture(scope="module")
def changed_copy(tmp_path_factory):
    """Copy firmware_py, hil and the tests, and change only the firmware."""
    folder = tmp_path_factory.mktemp("changed")
    for part in ("firmware_py", "hil", "tests"):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    for name, before, after in CHANGES:
        path = folder / "firmware_py" / name
        text, count = re.subn(before, after, path.read_text(), flags=re.MULTILINE)
        assert count == 1, before
        path.write_text(text)
    return folder


def output_of(folder, *arguments):
    """Run Python on the programs of a folder; return its output."""
    environment = {**os.environ, "PYTHONPATH": f"{folder}:{folder / 'tests'}", "PYTEST_ADDOPTS": ""}
    result = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, check=False, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_compiled_functions_are_those_of_the_changed_firmware(changed_copy, capsys):
    exec(FUNCTIONS, {})
    before, after = capsys.readouterr().out.splitlines(), output_of(changed_copy, "-c", FUNCTIONS).splitlines()
    assert len(after) == len(before) == 2
    for line, old_line in zip(after, before, strict=True):
        plain, compiled = line.split()
        assert plain == compiled
        assert line != old_line


@pytest.mark.proof  # the closed loop is compiled again
@pytest.mark.timeout(1800)
def test_closed_loop_uses_the_changed_firmware(changed_copy):
    assert output_of(ROOT, "-c", LOOP) != output_of(changed_copy, "-c", LOOP)
    # pytest fails if no test is selected.
    output_of(changed_copy, "-m", "pytest", "tests/process/test_twin.py", "-k", "mixture and coast")
