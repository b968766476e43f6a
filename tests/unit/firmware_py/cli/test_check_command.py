"""`rambler check`: findings, levels and output formats."""

import json
import os
import pty
import re
import select
import shutil
import socket
import subprocess
import sys
import threading
import tty
from types import SimpleNamespace

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import preflight
from firmware_py.cli.bench_session import BenchDevice
from firmware_py.cli.check import _device_finding
from firmware_py.cli.preflight import Level
from firmware_py.common.plan import Plan, PlanItem, PlanKind, to_text
from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    FixType,
    HeadingSample,
    NorthReference,
    PositionSample,
)
from firmware_py.system.store import Store

VEHICLE = """
[compass]
driver = "nmea"
port = "{}"
baud = 4800
[rudder]
driver = "volz"
port = "{}"
baud = 115200
[parameters]
LOG_KEEP_MB = 2
LOG_FREE_MB = 1
LOG_FILE_MB = 1
"""


@pytest.fixture
def state(tmp_path):
    (tmp_path / "state").mkdir()
    return tmp_path / "state"


@pytest.fixture
def check(tmp_path, state, capsys, monkeypatch):
    """Check a boat with silent ptys; return the exit code and the findings by subject."""
    monkeypatch.setattr("firmware_py.cli.check.LISTEN_S", 0.1)
    ends = [pty.openpty() for _ in range(2)]
    path = tmp_path / "boat.toml"
    path.write_text(VEHICLE.format(*(os.ttyname(slave) for _, slave in ends)))

    def run(*words):
        code = main(["check", str(path), "--state", str(state), "--json", *words])
        text = json.loads(capsys.readouterr().out)
        assert (code == 1) == (text["verdict"] == "fail") == any(row["level"] == "fail" for row in text["findings"])
        found = {}
        for row in text["findings"]:
            found.setdefault(row["subject"], []).append(row)
        return found

    run.compass = os.ttyname(ends[0][1])
    yield run
    for end in (end for pair in ends for end in pair):
        os.close(end)


def levels(rows):
    return [row["level"] for row in rows]


def store(state, **files):
    held = Store(state)
    for name, content in files.items():
        held.save(name.replace("_", "."), content.encode())
    held.close()


def test_new_boat_without_links_and_with_silent_devices(check):
    found = check()
    assert levels(found["parameters"]) == levels(found["state"]) == ["pass"]
    assert levels(found["storage"])[0] == "pass"
    assert found["storage"][0]["free_mb"] > 0
    (links,) = found["links"]
    assert (links["level"], "no ground station" in links["text"]) == ("warn", True)
    assert levels(found["compass"]) == levels(found["rudder"]) == ["fail"]
    assert found["compass"][0]["text"].endswith("silent; check power, wiring and baud rate")
    assert (found["compass"][0]["driver"], found["compass"][0]["accepted"]) == ("nmea", 0)


def test_each_finding_is_one_line(tmp_path, state, capsys, monkeypatch, check):
    assert main(["check", str(tmp_path / "boat.toml"), "--state", str(state)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert {line[:6] for line in lines} <= {"PASS  ", "WARN  ", "FAIL  "}
    assert any(line.startswith("WARN  links") for line in lines)


def test_stored_state_is_counted_and_damage_is_a_warning(check, state):
    mission = to_text(Plan.of(PlanKind.MISSION, (PlanItem(16, 3, x=1, y=2),)))
    store(state, parameters_param="CTL_K1 33\n", mission_plan=mission)
    found = check()
    assert (found["parameters"][0]["stored"], found["state"][0]["mission"]) == (1, 1)
    store(state, parameters_param="CTL_K1 33\nCTL_K1 4444444\nODD 1\n", fence_plan="?", resume_record="?")
    (state / "mission.plan.0").write_text("spoiled")
    found = check()
    assert levels(found["parameters"]) == ["warn", "warn"]
    texts = [row["text"] for row in found["state"]]
    assert levels(found["state"]) == ["warn"] * 3
    assert "mission.plan.0 is damaged" in texts[0]
    assert any("fence.plan ignored" in text for text in texts)
    assert any("resume.record ignored" in text for text in texts)


def test_too_small_loiter_radius_is_a_warning(check, state):
    store(state, parameters_param="LOIT_RADIUS 20\n")
    (valid, circle) = check()["parameters"]
    assert (valid["level"], circle["level"], circle["held_m"]) == ("pass", "warn", 78.0)
    assert circle["text"] == "LOIT_RADIUS 20 m: in a current the boat needs at least 78 m"


def test_lost_key_fails_and_readable_key_is_a_warning(check, state):
    (state / "signing.key.0").write_text("spoiled")
    (state / "signing.key.0").chmod(0o644)
    found = check()
    assert levels(found["state"]) == ["warn", "fail"]
    assert "rambler key" in found["state"][1]["text"]


def test_running_autopilot_is_reported(check, state, monkeypatch):
    from firmware_py.system.status_file import FoundStatus, Freshness  # noqa: PLC0415

    monkeypatch.setattr(
        "firmware_py.cli.preflight.find", lambda _directory, _now_s: FoundStatus(Freshness.RUNNING, {"pid": 77}, 0.1)
    )
    found = check()
    assert found["state"][0]["level"] == "warn"
    assert "process 77" in found["state"][0]["text"]


@pytest.mark.parametrize(
    ("free_mb", "level", "word"), [(0.5, "fail", "LOG_FREE_MB"), (2.5, "warn", "LOG_KEEP_MB"), (900, "pass", "free")]
)
def test_free_space_is_compared_with_the_log_limits(check, state, monkeypatch, free_mb, level, word):
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: SimpleNamespace(free=free_mb * 1e6))
    found = check()
    assert found["storage"][0]["level"] == level
    assert word in found["storage"][0]["text"]


@pytest.mark.parametrize(("logs_mb", "level"), [(1.4, "fail"), (2.0, "warn")])
def test_full_disk_fails_unless_old_logs_can_be_deleted(check, state, monkeypatch, logs_mb, level):
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: SimpleNamespace(free=0.5e6))
    (state / "logs").mkdir()
    (state / "logs/00000001.BIN").write_bytes(bytes(int(logs_mb * 1e6)))
    assert check()["storage"][0]["level"] == level


def test_state_directory_that_cannot_be_created_fails(check, state):
    state.rmdir()
    state.write_text("a file")
    found = check()
    assert levels(found["storage"]) == ["fail"]
    assert "state" not in found, "it is not made at the first start"


def test_check_creates_no_files(check, state):
    """A directory created by root could not be used by the user of the autopilot."""
    state.rmdir()
    found = check("--state", str(state / "of" / "boat"))
    assert levels(found["storage"]) == ["pass", "pass"]
    assert "will be created at the first start" in found["state"][0]["text"]
    assert not state.exists()


def test_file_in_place_of_the_log_directory_fails(check, state):
    (state / "logs").touch()
    assert "logs is not a directory" in check()["storage"][0]["text"]


def test_each_link_is_opened_and_open_access_is_a_warning(check, state):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken, socket.socket() as free:
        taken.bind(("127.0.0.1", 0))
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        urls = [
            "udpout:127.0.0.1:14550",
            f"udpin:127.0.0.1:{taken.getsockname()[1]}",
            f"udpin:0.0.0.0:{port}",
            f"udpin:0.0.0.0:{port}",
            "serial:/dev/none:57600",
            "carrier pigeon",
            f"tcpin:0.0.0.0:{port + 1}?trusted=1",
        ]
        found = check(*(word for url in urls for word in ("--link", url)))
    assert [row["url"] for row in found["links"]] == urls
    assert levels(found["links"])[:6] == ["pass", "fail", "warn", "fail", "fail", "fail"]
    texts = [row["text"] for row in found["links"]]
    assert "end the program that has the port" in texts[1]
    assert "rambler key set" in texts[2]
    assert "no such port" in texts[4]


def test_program_sharing_a_port_is_named(check, state):
    opener = (
        "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print('opened', flush=True); sys.stdin.read()"
    )
    ends = pty.openpty()
    port = os.ttyname(ends[1])
    command = [sys.executable, "-c", opener]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with (
        subprocess.Popen([*command, check.compass], **pipes) as other,
        subprocess.Popen([*command, port], **pipes) as third,
    ):
        assert other.stdout.readline() == third.stdout.readline() == b"opened\n"
        found = check("--link", f"serial:{port}:57600")
    for rows, number, path in ((found["compass"], other.pid, check.compass), (found["links"], third.pid, port)):
        assert rows[0]["level"] == "fail"
        assert re.fullmatch(rf"Port {path}: also open in .+ \(process {number}\); end that program", rows[0]["text"])
    assert "also open" not in found["rudder"][0]["text"]
    for end in ends:
        os.close(end)


HEADING = HeadingSample(2.0, 1.0, NorthReference.TRUE)
NO_FIX, FIX = PositionSample(2.0, FixType.NONE), PositionSample(2.0, FixType.FIX_3D, 0.1, 0.2)


@pytest.mark.parametrize(
    ("sample", "state", "accepted", "rejected", "text", "level", "word"),
    [
        (HEADING, DeviceState.RUNNING, 30, 1, "", Level.PASS, "14.5 Hz"),
        (HEADING, DeviceState.RUNNING, 30, 4, "", Level.WARN, "4 bad messages"),
        (HEADING, DeviceState.RUNNING, 30, 31, "", Level.FAIL, "31 bad messages"),
        (HEADING, DeviceState.FAULTY, 30, 0, "broken", Level.FAIL, "broken"),
        (HEADING, DeviceState.SILENT, 30, 0, "", Level.FAIL, "silent"),
        (HEADING, DeviceState.ABSENT, 30, 0, "no port x", Level.FAIL, "no port x"),
        (NO_FIX, DeviceState.RUNNING, 30, 0, "no fix", Level.WARN, "no fix yet"),
        (FIX, DeviceState.RUNNING, 30, 0, "", Level.PASS, "FIX_3D"),
        (None, DeviceState.STARTING, 0, 0, "data not understood: wrong baud rate?", Level.FAIL, "baud rate?"),
        (None, DeviceState.STARTING, 0, 9, "checksum", Level.FAIL, "checksum"),
    ],
)
def test_device_finding_depends_on_health_and_samples(sample, state, accepted, rejected, text, level, word):
    health = DeviceHealth(3.0, DeviceRole.COMPASS, state, accepted, rejected, text)
    count = 0 if sample is None else 30
    device = BenchDevice("compass", "nmea", "/dev/x", count=count, first_s=0.0, last=sample, health=health)
    finding = _device_finding(device)
    assert (finding.level, finding.subject) == (level, "compass")
    assert word in finding.text
    assert finding.values["rejected"] == rejected


def modem(*, answers):
    """Return the path of a pty that replies to AT commands, or not, and a function that ends it."""
    far, near = pty.openpty()
    tty.setraw(near)
    over = threading.Event()

    def serve():
        while not over.is_set():
            if select.select([far], [], [], 0.1)[0]:
                for command in os.read(far, 256).split(b"\r")[:-1]:
                    output = b"\r\n300234010753370\r\n" if command == b"AT+CGSN" else b""
                    os.write(far, output + b"\r\nOK\r\n" if answers else b"\r\n")

    thread = threading.Thread(target=serve)
    thread.start()

    def end():
        over.set()
        thread.join()
        os.close(near)
        os.close(far)

    return os.ttyname(near), end


@pytest.mark.parametrize(("answers", "level"), [(True, "pass"), (False, "fail")])
def test_modem_is_found_by_its_serial_number(check, monkeypatch, answers, level):
    monkeypatch.setattr(preflight, "MODEM_S", 5.0 if answers else 0.3)
    path, end = modem(answers=answers)
    try:
        links = check("--link", f"sbd:{path}")["links"]
    finally:
        end()
    assert links[0]["level"] == level
    assert links[0].get("imei") == ("300234010753370" if answers else None)
    assert "accepts commands from anyone" in links[1]["text"]
    assert "listen on" not in links[1]["text"], "a satellite is heard everywhere"
