"""The import law of the firmware, read from the imports themselves; it allows no exemption."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FIRMWARE = ROOT / "firmware_py"

# Rooms of the firmware, innermost first. A room imports only what stands in its row.
PLAIN = {"records", "intents", "plan", "angles", "plain", "plain_history", "plain_notes"}
BASE = {
    "clock",
    "params",
    "faults",
    "fault_kinds",
    "fault_table",
    "ports",
    "model",
    "serial_line",
    "realtime",
    "store",
    "timekeeper",
    "vehicle",
    "console",
    "plan_area",
    "plan_fault",
    "plan_items",
    "plan_rules",
    "planfiles",
    "system",
}
PURE = {"modes", "monitor", "failsafe", "estimate", "guidance", "control"}
EDGE = {"sensors", "actuator", "link", "log"}
LOOP = {
    "step",
    "step_state",
    "loop",
    "shelter",
    "health",
    "pilotage",
    "state",
    "requests",
    "resume",
    "helm",
    "lookout",
    "watch",
    "conditions",
}
TOP = {"assemble", "stored", "cli", "__main__"}
ALL = PLAIN | BASE | PURE | EDGE | LOOP | TOP

THIRD_PARTY_PLAIN = {"numpy"}
ONLY_IN = {"serial": {"serial_line"}, "pymavlink": {"link"}, "time": {"clock", "cli"}, "socket": {"clock", "link"}}
NEVER_IN_PURE = {"time", "serial", "pymavlink", "logging", "threading", "socket", "os", "random"}


def _room(path: Path) -> str:
    return path.relative_to(FIRMWARE).parts[0].removesuffix(".py")


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            assert all(alias.name != "*" for alias in node.names), f"{path}: star import"
            if node.module == "firmware_py":
                yield from (f"firmware_py.{alias.name}" for alias in node.names)
            else:
                yield node.module or ""


def _files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.py"))


def _allowed_rooms(room: str) -> set[str]:
    if room in PLAIN:
        return PLAIN
    if room in BASE:
        return PLAIN | BASE
    if room in PURE:
        # Never each other: estimate does not know guidance, nor modes the monitor.
        return PLAIN | (BASE - {"clock", "serial_line", "store", "console", "realtime"}) | {room}
    if room in EDGE:
        return PLAIN | (BASE - {"serial_line"}) | {room}
    if room in LOOP:
        return PLAIN | BASE | PURE | LOOP
    return ALL


@pytest.mark.parametrize("path", _files(FIRMWARE), ids=lambda path: str(path.relative_to(ROOT)))
def test_firmware_imports_obey_the_law(path):
    room = _room(path)
    if room == "__init__":
        assert list(_imports(path)) in ([], ["__future__"])
        return
    assert room in ALL, f"{path}: a new room needs a row in this test"
    for name in _imports(path):
        top, *rest = name.split(".")
        assert top not in ("hil", "tests"), f"{path} imports {name}"
        if top == "firmware_py":
            target = rest[0]
            # The package's own version string is no room.
            assert target == "__version__" or target in _allowed_rooms(room), f"{path} imports {name}"
            continue
        if top in ONLY_IN:
            assert room in ONLY_IN[top], f"{path} imports {name}"
        if room in PURE or room in ("step", "helm", "lookout", "pilotage", "state", "requests"):
            assert top not in NEVER_IN_PURE, f"{path} imports {name}"
        if room in PLAIN:
            assert top in sys.stdlib_module_names | THIRD_PARTY_PLAIN, f"{path} imports {name}"


HIL_MAY_IMPORT = {"records", "angles", "params", "model", "log", "plain", "system"}
# The bench measures the autopilot's own parts; it is the one place that may look inside.


@pytest.mark.parametrize("path", _files(ROOT / "hil"), ids=lambda path: str(path.relative_to(ROOT)))
def test_the_hil_knows_only_the_firmware_seam(path):
    for name in _imports(path):
        top, *rest = name.split(".")
        if top == "firmware_py":
            assert rest[0] in HIL_MAY_IMPORT, f"{path} imports {name}"
        if path.is_relative_to(ROOT / "hil" / "devices"):
            assert top not in ("fastcrc", "pynmeagps", "dynamixel_sdk"), f"{path} shares a codec: {name}"


def test_the_law_reads_something():
    assert len(_files(FIRMWARE)) > 30
    assert "firmware_py.guidance.guidance" in set(_imports(FIRMWARE / "step.py"))
