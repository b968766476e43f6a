"""`rambler status`: endings of earlier runs."""

import json

import pytest

from firmware_py.__main__ import main
from firmware_py.system.endings import ENDINGS_FILE, Ending, Endings, to_bytes
from firmware_py.system.slots import slot_path
from firmware_py.system.store import Store

UTC_S = 1_800_000_000.0
ENDINGS = Endings(
    {"watchdog": 3, "killed": 1, "stopped": 9},
    (*(Ending("watchdog", f"in core/step.py:{line} step", UTC_S + line) for line in range(5)), Ending("killed")),
)


@pytest.fixture
def state(tmp_path):
    store = Store(tmp_path / "state")
    store.save(ENDINGS_FILE, to_bytes(ENDINGS))
    store.close()
    return tmp_path / "state"


@pytest.fixture
def status(capsys):
    """Return the output of the command; no autopilot runs."""

    def run(directory, *words):
        assert main(["status", "--state", str(directory), *words]) == 1
        return capsys.readouterr().out

    return run


def test_json_has_all_endings(state, status):
    endings = json.loads(status(state, "--json"))["endings"]
    assert endings["counts"] == {"watchdog": 3, "killed": 1, "stopped": 9}
    assert endings["last"][0] == {"why": "watchdog", "text": "in core/step.py:0 step", "utc_s": UTC_S}
    assert endings["last"][-1] == {"why": "killed", "text": "", "utc_s": 0.0}
    assert len(endings["last"]) == 6


def test_lines_have_counts_and_the_last_three_endings(state, status):
    assert [line.strip() for line in status(state).splitlines()[1:]] == [
        "endings       watchdog 3, killed 1, stopped 9",
        "at an unknown time  killed",
        "2027-01-15 08:00:04 UTC  watchdog, in core/step.py:4 step",
        "2027-01-15 08:00:03 UTC  watchdog, in core/step.py:3 step",
    ]


def test_damaged_and_missing_endings(state, tmp_path, status):
    (tmp_path / "new").mkdir()
    assert json.loads(status(tmp_path / "new", "--json"))["endings"] == {}
    path = slot_path(state, ENDINGS_FILE, 0)
    path.write_bytes(path.read_bytes().replace(b"watchdog", b"watchdig", 1))
    assert json.loads(status(state, "--json"))["endings"] == {"error": f"{ENDINGS_FILE}.0 is damaged"}
    assert f"{ENDINGS_FILE}.0 is damaged" in status(state)
