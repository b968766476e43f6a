"""`rambler status`: endings of earlier runs, and the status of an autopilot."""

import json
import shutil
from types import SimpleNamespace

import pytest
from msgspec.structs import replace

from firmware_py.__main__ import main
from firmware_py.cli import status as command
from firmware_py.common.link_status import LinkStatus, PeerStatus, SatelliteStatus
from firmware_py.system.endings import ENDINGS_FILE, Ending, Endings, to_bytes
from firmware_py.system.slots import slot_path
from firmware_py.system.status_file import Freshness, StatusReading
from firmware_py.system.status_report import link_values
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


def test_damaged_endings_are_an_error_and_missing_ones_are_empty(state, tmp_path, status):
    (tmp_path / "new").mkdir()
    assert json.loads(status(tmp_path / "new", "--json"))["endings"] == {}
    path = slot_path(state, ENDINGS_FILE, 0)
    path.write_bytes(path.read_bytes().replace(b"watchdog", b"watchdig", 1))
    assert json.loads(status(state, "--json"))["endings"] == {"error": f"{ENDINGS_FILE}.0 is damaged"}
    assert f"{ENDINGS_FILE}.0 is damaged" in status(state)


PEER = PeerStatus(
    "10.0.0.7:14550",
    ground_station=True,
    has_place=True,
    signs=True,
    heard_age_s=1.5,
    sent_bytes=900,
    dropped=2,
    rejected=1,
)
SATELLITE = SatelliteStatus(
    "300234010753370",
    signal=4,
    waiting=3,
    dropped=0,
    sessions=7,
    failed=1,
    last_status=None,
    blocked_reason="",
    session_age_s=119.0,
    sent=5,
    sent_bytes=500,
    received=6,
    refused={"too long": 2, "no key": 1},
    day_credits=10,
    day_limit=50,
    month_credits=40,
    month_limit=0,
    total_credits=40,
)
OTHER_SATELLITE = replace(SATELLITE, imei="", signal=None, session_age_s=None, blocked_reason="no credits", refused={})
LINKS = (
    LinkStatus(
        "udpin:0.0.0.0:14550",
        "1 kB/s",
        (PEER, replace(PEER, ground_station=False, address="x", heard_age_s=None, signs=False, has_place=False)),
    ),
    LinkStatus("sbd:/dev/a", "-", (), SATELLITE, "no port"),
    LinkStatus("sbd:/dev/b", "-", (PEER,), OTHER_SATELLITE),
)
CONTENT = {
    "written_machine_s": 50.0, "user": "pi", "vehicle": "boat", "mode": "GUIDED", "armed": True, "note": "",
    "faults": [
        {"severity": "error", "fault": "POSITION_LOST", "since_s": 119.4, "text": "no fix"},
        {"severity": "warning", "fault": "BATTERY_LOW", "since_s": 120.0, "text": "low"},
        {"severity": "warning", "fault": "WIND_LOST", "since_s": None, "text": "no wind"},
    ],
    "devices": [],
    "links": [link_values(link) for link in LINKS],
    "rudder": {"angle_deg": -4.0},
    "traffic": {"count": 2, "nearest": [{"mmsi": 1}, {"mmsi": 2}]},
    "empty": {},
}  # fmt: skip
PEER_TEXT = "10.0.0.7:14550  last frame 1.5 s ago  900 bytes sent, 2 messages dropped, 1 bad frames  signed"
COUNTS = "5 messages of 500 bytes sent, 6 received, 0 dropped"
LINES = f"""\
boat in STATE: running, updated 1.2 s ago by user pi
faults        error POSITION_LOST for 119 s: no fix
              warning BATTERY_LOW for 2 min: low
              warning WIND_LOST for ?: no wind
links         udpin:0.0.0.0:14550  1 kB/s
                station {PEER_TEXT}
                peer x  nothing received  900 bytes sent, 2 messages dropped, 1 bad frames  pending: link full
              sbd:/dev/a  -  no peers  sending blocked: no port
                modem 300234010753370  signal 4 of 5  3 frames queued
                7 sessions, 1 failed, last 119 s ago; {COUNTS}
                credits 10 of 50 today, 40 this month
                refused 2 too long, 1 no key
              sbd:/dev/b  -
                modem not found  signal unknown  3 frames queued
                7 sessions, 1 failed, none yet, blocked: no credits; {COUNTS}
                credits 10 of 50 today, 40 this month
                station {PEER_TEXT}
now           mode GUIDED  armed True
rudder        angle_deg -4.0
traffic       count 2
                mmsi 1
                mmsi 2
disk          free_mb 123.5  total_mb 1000.0
"""


@pytest.fixture
def run_status(monkeypatch, capsys, tmp_path):
    """Return a function that runs the command with statuses of autopilots on this computer."""
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: SimpleNamespace(free=123_456_789, total=1e9))

    def run(readings, *words):
        monkeypatch.setattr(command, "find_status", lambda _directory, _machine_s: readings[0])
        monkeypatch.setattr(command, "find_all_statuses", lambda _machine_s: dict(enumerate(readings)))
        code = main(["status", *words])
        output = capsys.readouterr()
        return code, output.out.replace(str(tmp_path), "STATE"), output.err

    return run


def test_every_part_of_a_status_is_printed(run_status, tmp_path):
    reading = StatusReading(Freshness.RUNNING, CONTENT | {"state_directory": str(tmp_path)}, 1.23)
    for words in ((), ("--state", str(tmp_path))):
        code, output, error = run_status([reading], *words)
        assert (code, output.splitlines(), error) == (0, LINES.splitlines(), "")
    code, output, _ = run_status([reading], "--json")
    status = json.loads(output)
    assert (code, status["status"], status["age_s"], status["endings"]) == (0, "running", 1.2, {})
    assert status["disk"] == {"free_mb": 123.5, "total_mb": 1000.0}


def test_healthy_boat_without_links_has_none(run_status):
    reading = StatusReading(Freshness.RUNNING, CONTENT | {"faults": [], "links": []}, 1.0)
    lines = [line.rstrip() for line in run_status([reading])[1].splitlines()]
    assert lines[:3] == ["boat in ?: running, updated 1 s ago by user pi", "faults        none", "links         none"]


def test_status_is_that_of_the_only_autopilot_that_runs(run_status, tmp_path):
    names = [str(tmp_path / name) for name in "ab"]
    running = [StatusReading(Freshness.RUNNING, {"state_directory": name}, 1.0) for name in names]
    old = StatusReading(Freshness.STALE, {"state_directory": names[0]}, 99.0, "it hangs")
    assert run_status([running[0], old])[:2] == (0, "autopilot in STATE/a: running, updated 1 s ago\n")
    assert run_status([old])[:2] == (1, "autopilot in STATE/a: stale, updated 99 s ago: it hangs\n")
    code, _, error = run_status(running)
    assert (code, error.endswith(f"choose one with --state: {names[0]}, {names[1]}\n")) == (2, True)
    assert run_status([]) == (1, "autopilot in ?: absent: no autopilot runs here\n", "")
    absent = StatusReading(Freshness.ABSENT, reason="not running")
    code, _, error = run_status([absent], "--state", names[0])
    assert (code, "is not a directory" in error) == (2, True)
    assert run_status([running[0]], "--state", names[0])[0] == 0  # although the directory has gone


def test_status_of_another_version_is_not_printed(run_status):
    reading = StatusReading(Freshness.STALE, CONTENT | {"faults": [{}]}, 1.0)
    assert run_status([reading]) == (1, "stale; status of another version, use --json\n", "")
