"""The drills pass with the firmware and fail with mutations of it."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from support.paths import ROOT


def run_drills(tree, directory, *words):
    """Run drills with the firmware of a tree; return the exit code and the outcomes."""
    file = directory / "outcomes.json"
    command = [sys.executable, "-m", "hil", "drill", "--jobs", "2", "--json", str(file), *words]
    process = subprocess.run(
        command, cwd=tree, env={**os.environ, "PYTHONPATH": str(tree)}, capture_output=True, text=True, check=False
    )
    assert file.exists(), process.stdout + process.stderr
    return process.returncode, json.loads(file.read_text())


def test_drill_measures_report_and_recovery(tmp_path):
    code, (outcome,) = run_drills(ROOT, tmp_path, "--only", "servo's cable", "--moment", "turning")
    assert (code, outcome["misses"]) == (0, [])
    assert 0.0 < outcome["told_s"][0] < 1.5
    assert 0.0 < outcome["over_s"][0] < 5.0


# File, original text, mutation, and the drills that must detect it.
MUTATIONS = (
    (
        "faults/table.py",
        "debounce_s=0.5,\n        clear_s=1.0",
        "debounce_s=5.0,\n        clear_s=1.0",
        "compass silent",
    ),
    ("common/parameter_table.py", '"POS_TIMEOUT_S", 5.0', '"POS_TIMEOUT_S", 50.0', "position lost"),
    ("core/rudder_demand.py", "now_s - lost_s <= settings.rudder.hold_s", "now_s - lost_s >= 0.0", "no heading"),
    ("common/angles.py", "(angle_rad + PI) % TWO_PI - PI", "angle_rad % TWO_PI", "position jumps"),
    ("safety/rudder_monitor.py", "OVERLOAD_S: Final = 2.0", "OVERLOAD_S: Final = 20.0", "servo overloaded"),
    ("faults/table.py", "< min_charge +", "> min_charge +", "battery low"),
    ("faults/table.py", "tick.supply_v < tick.supply_low_v", "tick.supply_v > tick.supply_low_v", "supply low"),
    ("faults/table.py", 'recovery="Compass no longer frozen"', 'recovery=""', "compass frozen"),
    ("safety/rudder_monitor.py", "RESPONSE_S: Final = 1.5", "RESPONSE_S: Final = 150.0", "rudder jammed"),
    ("safety/rudder_monitor.py", "if state.relieved_s is None or", "if state is not None or", "rudder jammed"),
    ("safety/rudder_monitor.py", "if state.relieved_s is None or", "if state is not None or", "servo overloaded"),
    ("faults/table.py", 'text="Fence breached"', 'text="Fence"', "outside the fence"),
    ("safety/failsafe.py", "inputs.resume or TABLE", "TABLE", "station silent"),
    ("faults/table.py", "VOLTAGE_MARGIN_FACTOR: Final = 1.03", "VOLTAGE_MARGIN_FACTOR: Final = 1.0", "supply low"),
    ("faults/table.py", "TEMPERATURE_MARGIN_C: Final = 5.0", "TEMPERATURE_MARGIN_C: Final = 0.0", "servo hot"),
    (
        "guidance/task_follower.py",
        "HeadingTarget(line_status.course_rad, over",
        "HeadingTarget(-line_status.course_rad, over",
        "outside the fence",
    ),
    ("loop.py", "    centred_readings = 0\n", "    centred_readings = MIN_SAFE_READINGS\n", "ended and started"),
    ("estimate/sources.py", "if is_usable(b,", "if False and is_usable(b,", "first of two compasses"),
    ("faults/latch.py", ">= row.debounce_s)", ">= 0.0)", "troubles of a second"),
    ("faults/latch.py", "now_s - last_s < row.clear_s)", "now_s - last_s < 0.0)", "supply low"),
    ("safety/failsafe.py", "(active=state.active)\n    # A", "()\n    # A", "operator steers on"),
    ("safety/failsafe.py", "in PRECEDENCE if", "in reversed(PRECEDENCE) if", "servo hot and supply low"),
    ("safety/failsafe.py", "HEADING if inputs.by_failsafe else", "HEADING if False else", "another failsafe"),
    ("safety/failsafe.py", "HEADING if inputs.by_failsafe else", "HEADING if state.fault else", "another failsafe"),
    ("estimate/sources.py", "PLATEAU_TIME_S: Final = 2.0", "PLATEAU_TIME_S: Final = 2e3", "turned by a breaking wave"),
    ("core/estimate_step.py",
     "position.predict(replace(position_state, dead_reckoning=advanced), now_s, over_ground_m_s)",
     "replace(position_state, dead_reckoning=advanced)", "position lost on a mission"),
)  # fmt: skip


@pytest.mark.proof
@pytest.mark.parametrize(
    ("file", "original", "mutant", "drill"), MUTATIONS, ids=[f"{row[3]}: {row[2]}" for row in MUTATIONS]
)
def test_mutation_is_detected_by_its_drill(file, original, mutant, drill, tmp_path):
    """`pytest -m proof tests/process/test_drill.py`."""
    for name in ("firmware_py", "hil", "params"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    path = tmp_path / "firmware_py" / file
    text = path.read_text()
    assert original in text, f"{file} no longer contains {original!r}"
    path.write_text(text.replace(original, mutant))
    code, outcomes = run_drills(tmp_path, tmp_path, "--only", drill, "--moment", "straight", "--moment", "turning")
    assert code == 1, outcomes
    assert any(outcome["misses"] for outcome in outcomes)


@pytest.mark.proof
def test_all_drills_pass(tmp_path):
    """`pytest -m proof tests/process/test_drill.py -k all_drills`: every drill at every moment, and all pairs."""
    code, outcomes = run_drills(ROOT, tmp_path, "--pairs")
    print(f"{len(outcomes)} drills, {sum(bool(outcome['misses']) for outcome in outcomes)} missed")
    assert code == 0, [outcome for outcome in outcomes if outcome["misses"]]
