"""`rambler check`: findings, levels and output formats."""

import json
import math
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
from itertools import islice
from types import SimpleNamespace

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import check as command
from firmware_py.cli import preflight
from firmware_py.cli.bench_session import SECTION_ORDER, BenchDevice, BenchSession
from firmware_py.cli.check import check_device
from firmware_py.cli.preflight import Level
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind, to_text
from firmware_py.common.records import (
    DepthSample,
    DeviceHealth,
    DeviceRole,
    DeviceState,
    FixType,
    HeadingSample,
    NorthReference,
    PositionSample,
    RudderCommand,
    WindReference,
    WindSample,
)
from firmware_py.plans.items import Command
from firmware_py.system.status_file import Freshness, StatusReading
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
    """Check a boat with silent ptys; return the findings by subject."""
    monkeypatch.setattr("firmware_py.cli.check.LISTEN_TIME_S", 0.1)
    ptys = [pty.openpty() for _ in range(2)]
    path = tmp_path / "boat.toml"
    path.write_text(VEHICLE.format(*(os.ttyname(slave) for _, slave in ptys)))

    def run(*words):
        code = main(["check", str(path), "--state", str(state), "--json", *words])
        result = json.loads(capsys.readouterr().out)
        assert (code == 1) == (result["verdict"] == "fail") == any(row["level"] == "fail" for row in result["findings"])
        findings = {}
        for row in result["findings"]:
            findings.setdefault(row["subject"], []).append(row)
        return findings

    run.compass_port = os.ttyname(ptys[0][1])
    yield run
    for descriptor in (end for pair in ptys for end in pair):
        os.close(descriptor)


def levels(findings):
    return [row["level"] for row in findings]


def texts(findings):
    return [row["text"] for row in findings]


def save(state, **files):
    store = Store(state)
    for name, content in files.items():
        store.save(name.replace("_", "."), content.encode())
    store.close()


def bench_device(role, driver, port, sample=None, text="", state=DeviceState.STARTING):
    device = BenchDevice(role, driver, port)
    device.health = DeviceHealth(0.0, DeviceRole.COMPASS, state, 5, 0, text)
    if sample is not None:
        device.last_sample, device.sample_count, device.first_sample_s = sample, 5, 0.0
    return device


@pytest.mark.parametrize(
    ("driver", "port", "text", "expected"),
    [
        ("nmea", "/dev/c", "", "silent; check power, wiring and baud rate"),
        ("nmea2000", "udp:2002", "", "silent; check the address and the device that sends to it"),
        (
            "volz",
            "/dev/c",
            "no reply from servo id 2",
            "no reply from servo id 2; check power, wiring and baud rate",
        ),
        ("nmea", "/dev/c", "no fix", "no fix"),
    ],
)
def test_silent_device_names_what_to_check(driver, port, text, expected):
    finding = check_device(bench_device("compass", driver, port, text=text))
    assert (finding.level, finding.text) == (Level.FAIL, f"{driver} on {port}: {expected}")


@pytest.mark.parametrize(
    ("roll_deg", "pitch_deg", "level"),
    [(None, None, Level.PASS), (-45.0, 45.0, Level.PASS), (-46.0, 0.0, Level.WARN), (0.0, 46.0, Level.WARN)],
)
def test_boat_that_seems_to_lie_on_its_side_is_a_warning_about_the_mounting(roll_deg, pitch_deg, level):
    roll_rad, pitch_rad = (None if angle is None else math.radians(angle) for angle in (roll_deg, pitch_deg))
    sample = HeadingSample(1.0, 0.5, NorthReference.MAGNETIC, roll_rad=roll_rad, pitch_rad=pitch_rad)
    finding = check_device(bench_device("compass", "rion", "/dev/c", sample, state=DeviceState.RUNNING))
    assert (finding.level, finding.text.endswith("check the mounting of the compass")) == (level, level is Level.WARN)


@pytest.mark.parametrize(("last_s", "rate_hz"), [(0.4, None), (0.5, 8.0), (2.0, 2.0)])
def test_rate_needs_half_a_second_of_samples(last_s, rate_hz):
    device = bench_device("wind", "nmea", "/dev/w", WindSample(last_s, 3.0, 0.0, WindReference.APPARENT))
    assert device.rate_hz() == rate_hz


def test_new_boat_has_a_warning_about_links_and_fails_for_silent_devices(check):
    findings = check()
    assert levels(findings["parameters"]) == levels(findings["state"]) == ["pass"]
    assert (levels(findings["storage"])[0], findings["storage"][0]["free_mb"] > 0) == ("pass", True)
    (links,) = findings["links"]
    assert (links["level"], "no ground station" in links["text"]) == ("warn", True)
    assert levels(findings["compass"]) == levels(findings["rudder"]) == ["fail"]
    compass = findings["compass"][0]
    assert compass["text"].endswith("silent; check power, wiring and baud rate")
    assert (compass["driver"], compass["accepted"]) == ("nmea", 0)


@pytest.mark.usefixtures("check")
def test_each_finding_is_one_line(tmp_path, state, capsys):
    assert main(["check", str(tmp_path / "boat.toml"), "--state", str(state)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert {line[:6] for line in lines} <= {"PASS  ", "WARN  ", "FAIL  "}
    assert any(line.startswith("WARN  links") for line in lines)


def test_stored_state_is_counted_and_damage_is_a_warning(check, state):
    mission = to_text(Plan.of(PlanKind.MISSION, (PlanItem(Command.WAYPOINT, 3, x=1, y=2),)))
    save(state, parameters_param="CTL_K1 33\n", mission_plan=mission)
    findings = check()
    assert (findings["parameters"][0]["stored"], findings["state"][0]["mission"]) == (1, 1)
    save(state, parameters_param="CTL_K1 33\nCTL_K1 4444444\nODD 1\n", fence_plan="?", resume_record="?")
    (state / "mission.plan.0").write_text("spoiled")
    findings = check()
    assert (levels(findings["parameters"]), levels(findings["state"])) == (["warn"] * 2, ["warn"] * 3)
    text = "\n".join(texts(findings["state"]))
    assert "mission.plan.0 is damaged" in text.splitlines()[0]
    assert "fence.plan ignored" in text
    assert "resume.record ignored" in text


def test_too_small_loiter_radius_is_a_warning(check, state):
    save(state, parameters_param="LOIT_RADIUS 20\n")
    (valid, circle) = check()["parameters"]
    assert (valid["level"], circle["level"], circle["held_m"]) == ("pass", "warn", 78.0)
    assert circle["text"] == "LOIT_RADIUS 20 m: in a current the boat needs at least 78 m"


def test_lost_signing_key_fails_and_key_readable_by_others_is_a_warning(check, state):
    (state / "signing.key.0").write_text("spoiled")
    (state / "signing.key.0").chmod(0o644)
    findings = check()["state"]
    assert (levels(findings), "rambler key" in findings[1]["text"]) == (["warn", "fail"], True)


def test_running_autopilot_is_a_warning(check, monkeypatch):
    status = StatusReading(Freshness.RUNNING, {"pid": 77}, 0.1)
    monkeypatch.setattr("firmware_py.cli.preflight.find_status", lambda _directory, _now_s: status)
    finding = check()["state"][0]
    assert (finding["level"], "process 77" in finding["text"]) == ("warn", True)


@pytest.mark.parametrize(
    ("free_mb", "logs_mb", "level", "word"),
    [
        (0.9, 0.0, "fail", "LOG_FREE_MB"),
        (1.0, 0.0, "warn", "LOG_KEEP_MB"),
        (2.9, 0.0, "warn", "LOG_KEEP_MB"),
        (3.0, 0.0, "pass", "free"),
        (1.0, 2.0, "pass", "free"),
        (0.5, 1.5, "fail", "LOG_FREE_MB"),
        (0.5, 1.6, "warn", "LOG_KEEP_MB"),  # old logs can be deleted
    ],
)
def test_free_space_and_logs_are_compared_with_the_limits(check, state, monkeypatch, free_mb, logs_mb, level, word):
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: SimpleNamespace(free=free_mb * 1e6))
    (state / "logs").mkdir()
    (state / "logs/00000001.BIN").write_bytes(bytes(int(logs_mb * 1e6)))
    finding = check()["storage"][0]
    assert (finding["level"], word in finding["text"]) == (level, True)


@pytest.mark.parametrize(
    ("sync_s", "level"), [(0.2, Level.PASS), (0.21, Level.WARN), (1.0, Level.WARN), (1.01, Level.FAIL)]
)
def test_level_of_storage_depends_on_the_write_time(state, monkeypatch, sync_s, level):
    times_s = iter((0.0, sync_s))
    monkeypatch.setattr(preflight, "time", SimpleNamespace(monotonic=lambda: next(times_s)))
    *_, finding = preflight.check_storage(state, ParameterSet())
    assert (finding.level, finding.values["sync_s"]) == (level, sync_s)


@pytest.mark.parametrize(("resolution_s", "level"), [(1e-9, Level.PASS), (1e-3, Level.PASS), (1.1e-3, Level.FAIL)])
def test_coarse_monotonic_clock_fails(monkeypatch, resolution_s, level):
    monkeypatch.setattr(preflight.time, "clock_getres", lambda _clock: resolution_s)
    *_, finding = preflight.check_clocks()
    assert (finding.level, finding.text) == (level, f"monotonic clock resolution {1e9 * resolution_s:.0f} ns")


def test_file_in_place_of_a_directory_fails(check, state):
    (state / "logs").touch()
    assert "logs is not a directory" in check()["storage"][0]["text"]
    shutil.rmtree(state)
    state.write_text("a file")
    findings = check()
    assert levels(findings["storage"]) == ["fail"]
    assert "state" not in findings  # the first start could not create the directory


def test_check_creates_no_files(check, state):
    """A directory created by root could not be used by the user of the autopilot."""
    state.rmdir()
    findings = check("--state", str(state / "of" / "boat"))
    assert levels(findings["storage"]) == ["pass", "pass"]
    assert "will be created at the first start" in findings["state"][0]["text"]
    assert not state.exists()


def test_each_link_is_opened_and_open_access_is_a_warning(check):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as used_socket, socket.socket() as free_socket:
        used_socket.bind(("127.0.0.1", 0))
        free_socket.bind(("127.0.0.1", 0))
        port = free_socket.getsockname()[1]
        rows = [
            ("udpout:127.0.0.1:14550", "pass", ""),
            (f"udpin:127.0.0.1:{used_socket.getsockname()[1]}", "fail", "end the program that has the port"),
            (f"udpin:0.0.0.0:{port}", "warn", "rambler key set"),
            (f"udpin:0.0.0.0:{port}", "fail", ""),
            ("serial:/dev/none:57600", "fail", "no such port"),
            ("not a url", "fail", ""),
        ]
        trusted_url = f"tcpin:0.0.0.0:{port + 1}?trusted=1"
        urls = [*(url for url, _, _ in rows), trusted_url]
        findings = check(*(word for url in urls for word in ("--link", url)))["links"]
    assert [finding["url"] for finding in findings] == urls
    for finding, (_, level, text) in zip(findings, rows, strict=False):
        assert (finding["level"], text in finding["text"]) == (level, True), finding


def test_program_that_shares_a_port_is_named(check):
    code = (
        "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print('opened', flush=True); sys.stdin.read()"
    )
    ptys = pty.openpty()
    port = os.ttyname(ptys[1])
    command = [sys.executable, "-c", code]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with (
        subprocess.Popen([*command, check.compass_port], **pipes) as compass_user,
        subprocess.Popen([*command, port], **pipes) as link_user,
    ):
        assert compass_user.stdout.readline() == link_user.stdout.readline() == b"opened\n"
        findings = check("--link", f"serial:{port}:57600")
    for subject, pid, path in (("compass", compass_user.pid, check.compass_port), ("links", link_user.pid, port)):
        finding = findings[subject][0]
        assert finding["level"] == "fail"
        assert re.fullmatch(rf"Port {path}: also open in .+ \(process {pid}\); end that program", finding["text"])
    assert "also open" not in findings["rudder"][0]["text"]
    for descriptor in ptys:
        os.close(descriptor)


HEADING = HeadingSample(2.0, 1.0, NorthReference.TRUE)
NO_FIX, FIX = PositionSample(2.0, FixType.NONE), PositionSample(2.0, FixType.FIX_3D, 0.1, 0.2)


@pytest.mark.parametrize(
    ("sample", "state", "accepted", "rejected", "text", "level", "word"),
    [
        (HEADING, DeviceState.RUNNING, 30, 1, "", Level.PASS, "14.5 Hz"),
        (HEADING, DeviceState.RUNNING, 30, 2, "", Level.PASS, "14.5 Hz"),
        (HEADING, DeviceState.RUNNING, 30, 3, "", Level.WARN, "3 bad messages"),
        (HEADING, DeviceState.RUNNING, 60, 3, "", Level.PASS, "14.5 Hz"),
        (HEADING, DeviceState.RUNNING, 30, 30, "", Level.WARN, "30 bad messages"),
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
    samples = {"sample_count": 0 if sample is None else 30, "first_sample_s": 0.0, "last_sample": sample}
    finding = check_device(BenchDevice("compass", "nmea", "/dev/x", health=health, **samples))
    assert (finding.level, finding.subject, finding.values["rejected"]) == (level, "compass", rejected)
    assert word in finding.text


@pytest.mark.parametrize(
    ("role", "sample", "accepted", "text", "level", "word"),
    [
        ("depth", DepthSample(3.0, 12.34, 0.5), 30, "", Level.PASS, "depth_m 12.34, transducer_m 0.5"),
        ("depth", None, 30, "SDDPT: no bottom", Level.WARN, "SDDPT: no bottom; check the sensor if it should"),
        ("depth", None, 0, "", Level.FAIL, "silent"),
        ("wind", WindSample(3.0, 5.0, 1.0, WindReference.APPARENT), 30, "", Level.PASS, "apparent_wind_angle_deg 57.3"),
        ("wind", WindSample(3.0, 5.0, 1.0, WindReference.NORTH), 30, "", Level.PASS, "wind_from_true_deg 57.3"),
        ("wind", None, 1, "WIMWV: no wind", Level.WARN, "WIMWV: no wind"),
        ("compass", None, 1, "no heading", Level.FAIL, "no heading"),
        ("ais", None, 0, "", Level.WARN, "no vessel received"),
    ],
)
def test_wind_sensor_echo_sounder_and_ais_without_samples_may_be_a_warning(role, sample, accepted, text, level, word):
    health = DeviceHealth(3.0, DeviceRole.DEPTH, DeviceState.RUNNING, accepted, 0, text)
    samples = {"sample_count": 0 if sample is None else 30, "first_sample_s": 0.0, "last_sample": sample}
    finding = check_device(BenchDevice(role, "nmea", "/dev/x", health=health, **samples))
    assert finding.level is level
    assert word in finding.text


@pytest.fixture
def modem_pty():
    """Return a function that opens a pty which replies to AT commands like a modem, or with empty lines."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    is_over = threading.Event()
    threads = []

    def serve(replies):
        while not is_over.is_set():
            if select.select([master], [], [], 0.1)[0]:
                for command in os.read(master, 256).split(b"\r")[:-1]:
                    serial_number = b"\r\n300234010753370\r\n" if command == b"AT+CGSN" else b""
                    os.write(master, serial_number + b"\r\nOK\r\n" if replies else b"\r\n")

    def start(*, replies):
        threads.append(threading.Thread(target=serve, args=(replies,)))
        threads[0].start()
        return os.ttyname(slave)

    yield start
    is_over.set()
    threads[0].join()
    os.close(slave)
    os.close(master)


@pytest.mark.parametrize(("reply_s", "level", "waited_s"), [(11.9, Level.PASS, 11.9), (99.0, Level.FAIL, 12.0)])
def test_modem_has_twelve_seconds_for_its_reply(monkeypatch, reply_s, level, waited_s):
    now_s, polls_s = [100.0], []

    def sleep(seconds):
        now_s[0] += seconds

    modem = SimpleNamespace(
        poll=polls_s.append, receive=lambda _descriptor: None, descriptors=lambda: [7],
        satellite_status=lambda at_s: SimpleNamespace(imei="1" if at_s - 100.0 > reply_s - 0.001 else ""),
    )  # fmt: skip
    monkeypatch.setattr(preflight, "machine_s", lambda: now_s[0])
    monkeypatch.setattr(preflight, "time", SimpleNamespace(sleep=sleep))
    assert preflight._check_modem("sbd:x", modem).level is level
    assert (polls_s[1], now_s[0]) == (pytest.approx(100.05), pytest.approx(100.0 + waited_s, abs=0.06))


def test_devices_are_polled_ten_times_a_second_with_servo_torque_off():
    times_s, descriptors, commands, samples = (
        [0.0],
        [],
        [],
        iter([(WindSample(1.0, 3.0, 0.0, WindReference.NORTH),) * 3]),
    )

    def driver(descriptor):
        return SimpleNamespace(
            receive=lambda _now_s: None, poll=lambda: next(samples, ()), health=lambda now_s: now_s,
            fileno=lambda: descriptor, command=lambda command, now_s: commands.append((command, now_s)),
        )  # fmt: skip

    def wait(end_s, polled_descriptors):
        times_s.append(end_s)
        descriptors.append(polled_descriptors)

    session = BenchSession(SimpleNamespace(**dict.fromkeys(SECTION_ORDER)))
    drivers = {"wind": driver(7), "rudder": driver(-1), "compass": None}
    session.devices = [BenchDevice(role, "x", "/dev/x", driver) for role, driver in drivers.items()]
    session._clock = SimpleNamespace(now_s=lambda: times_s[-1], wait=wait)
    polls = list(islice(session.listen(2.95), 99))
    assert (len(polls), list(map(len, polls[:2]))) == (30, [3, 0])
    assert descriptors == [[7]] * 30
    assert times_s[1] == pytest.approx(0.1)
    assert commands == [(RudderCommand(0.0, torque_on=False), t_s) for t_s in times_s[:-1]]
    wind, _, compass = session.devices
    assert (wind.sample_count, wind.first_sample_s, wind.last_sample.t_s, wind.health) == (3, 1.0, 1.0, times_s[-1])
    assert (compass.sample_count, compass.health) == (0, None)


def test_devices_are_read_for_three_seconds(monkeypatch):
    calls = []
    session = SimpleNamespace(
        devices=[], close=lambda: calls.append("close"), listen=lambda seconds: calls.append(seconds) or ()
    )
    monkeypatch.setattr(command, "BenchSession", lambda _vehicle: session)
    assert list(command._check_devices(None)) == []
    assert calls == [3.0, "close"]


@pytest.mark.parametrize(("replies", "level"), [(True, "pass"), (False, "fail")])
def test_modem_passes_if_it_sends_its_serial_number(check, modem_pty, monkeypatch, replies, level):
    monkeypatch.setattr(preflight, "MAX_MODEM_REPLY_S", 5.0 if replies else 0.3)
    modem, access = check("--link", f"sbd:{modem_pty(replies=replies)}")["links"]
    assert (modem["level"], modem.get("imei")) == (level, "300234010753370" if replies else None)
    assert "accepts commands from anyone" in access["text"]
    assert "listen on" not in access["text"]  # no remedy for a satellite link
