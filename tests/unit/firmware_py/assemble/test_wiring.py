"""Start of the autopilot: parameters, reports, failed starts, late disks, released resources."""

import argparse
import os
import platform
import select
import socket
import threading
from pathlib import Path

import pytest

from firmware_py.__main__ import main
from firmware_py.assemble.wiring import Options, assemble, vehicle_parameters
from firmware_py.cli.run import _supervise
from firmware_py.common.records import RudderCommand, Severity
from firmware_py.common.reports import Output
from firmware_py.link.signing import KeyRecord, find_key, to_text
from firmware_py.system.clock import machine_s
from firmware_py.system.console import Console
from firmware_py.system.serial_port import PortError
from firmware_py.system.state_directory import SIGNING_FILE, StateFiles, read_key
from firmware_py.system.status_file import Freshness, find_status
from firmware_py.system.store import Store
from firmware_py.vehicle import load
from support.link import SNAPSHOT
from support.program import unused_ports

VEHICLE = """
[compass]
driver = "nmea"
port = "/dev/none-a"
baud = 4800
[rudder]
driver = "volz"
port = "/dev/none-b"
baud = 115200
[parameters]
CTL_K1 = 41
STAT_BOOTCNT = 77
"""


@pytest.fixture
def vehicle(tmp_path):
    (tmp_path / "boat.toml").write_text(VEHICLE)
    return load(tmp_path / "boat.toml")


def start(vehicle, directory):
    """Start an autopilot and end it; return its parameters."""
    assembly = assemble(vehicle, Options(directory / "state", wait=True))
    values = assembly.parts.autopilot.parameters()
    assembly.close()
    return values


def test_missing_port_is_an_error_unless_the_autopilot_waits(vehicle, tmp_path):
    with pytest.raises(PortError, match="/dev/none-a"):
        assemble(vehicle, Options(tmp_path / "state"))
    Store(tmp_path / "state").close()  # it is not locked


def test_starts_are_counted_and_the_vehicle_file_does_not_set_the_count(vehicle, tmp_path):
    assert vehicle_parameters(vehicle)["STAT_BOOTCNT"] == 0.0
    assert [start(vehicle, tmp_path)["STAT_BOOTCNT"] for _ in range(3)] == [1.0, 2.0, 3.0]
    assert start(vehicle, tmp_path)["CTL_K1"] == 41.0


def test_ground_stations_can_access_logs_and_uploads(vehicle, tmp_path):
    assembly = assemble(vehicle, Options(tmp_path / "state", wait=True))
    try:
        tree = assembly.endpoint._services.tree
        assert {name: area.writable for name, area in tree.areas.items()} == {"logs": False, "uploads": True}
        assert assembly.endpoint.descriptors()
    finally:
        assembly.close()


@pytest.mark.parametrize(("machine", "uid"), [(b"machine\n", 9949093198791115248), (None, 0)])
def test_version_has_an_id_of_the_computer(vehicle, tmp_path, monkeypatch, machine, uid):
    def read(path, max_bytes):
        assert (path, max_bytes) == (Path("/etc/machine-id"), 4096)
        if machine is None:
            raise FileNotFoundError
        return machine

    monkeypatch.setattr("firmware_py.assemble.wiring.read_regular", read)
    monkeypatch.setattr("firmware_py.assemble.wiring.__version__", "4.5.6.dev1")
    assembly = assemble(vehicle, Options(tmp_path / "state", wait=True))
    assembly.close()
    version = assembly.endpoint._context.version
    assert (version.major, version.minor, version.patch, version.uid) == (4, 5, 6, uid)


def test_status_is_written_and_removed_at_the_end(vehicle, tmp_path):
    assembly = assemble(vehicle, Options(tmp_path / "state", wait=True))
    assembly.parts.after_tick(Output(RudderCommand(0.0, True), SNAPSHOT, ()), 1.0)
    reading = find_status(tmp_path / "state", machine_s())
    assembly.close()
    assert reading.freshness is Freshness.RUNNING
    content = reading.content
    assert [content[name] for name in ("vehicle", "pid", "starts", "uptime_s", "update")] == [
        "boat",
        os.getpid(),
        1,
        1.0,
        "",
    ]
    assert content["state_directory"] == str(tmp_path / "state")
    names = ("rambler", "git", "python", "numpy", "pyserial", "pymavlink", "kernel", "machine")
    assert tuple(content["versions"]) == names
    assert content["versions"]["python"] == platform.python_version()
    assert find_status(tmp_path / "state", machine_s()).freshness is Freshness.ABSENT


class FakeLockstepClock:
    """The lockstep clock without the socket of the HIL."""

    def __init__(self, path, names, written, settle, descriptors):
        self.path, self.names = path, names
        self.written, self.settle, self.descriptors = written, settle, descriptors

    def now_s(self):
        return 7.0

    def utc_s(self):
        return 1.7e9


@pytest.mark.parametrize(("status", "freshness"), [(False, Freshness.ABSENT), (True, Freshness.RUNNING)])
def test_lockstep_uses_the_clock_of_the_hil_and_writes_a_status_on_request(
    vehicle, tmp_path, monkeypatch, status, freshness
):
    monkeypatch.setattr("firmware_py.assemble.wiring.LockstepClock", FakeLockstepClock)
    assembly = assemble(vehicle, Options(tmp_path / "state", wait=True, lockstep="socket", status=status))
    clock, parts = assembly.parts.clock, assembly.parts
    assert (clock.path, clock.names, clock.written(), clock.descriptors()) == (
        "socket", ["/dev/none-a", "/dev/none-b"], [0, 0], [-1, -1],
    )  # fmt: skip
    assert (clock.settle, parts.tick_on_compass) == (parts.store.settle, False)
    parts.after_tick(Output(RudderCommand(0.0, True), SNAPSHOT, ()), 1.0)
    assert find_status(tmp_path / "state", machine_s()).freshness is freshness
    assembly.close()


@pytest.mark.parametrize(("driver", "is_prompt"), [(None, True), ("nmea", True), ("bno08x_rvc", False)])
@pytest.mark.parametrize("may_set_clock", [True, False])
def test_second_compass_without_north_may_be_late(tmp_path, driver, is_prompt, may_set_clock):
    second = "" if driver is None else f'[compass_b]\ndriver = "{driver}"\nport = "/dev/none-c"\nbaud = 115200\n'
    (tmp_path / "boat.toml").write_text(VEHICLE + second)
    options = Options(tmp_path / "state", wait=True, may_set_clock=may_set_clock)
    assembly = assemble(load(tmp_path / "boat.toml"), options)
    assembly.close()
    parts = assembly.parts
    assert (parts.compass_b_is_prompt, parts.compass_b is None, parts.tick_on_compass) == (is_prompt, not driver, True)
    assert (parts.clock_setter is not None) is may_set_clock


def test_nmea_output_gets_each_tick(vehicle, tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(30.0)
        url = f"nmea:udpout:127.0.0.1:{listener.getsockname()[1]}?sentences=HDT"
        assembly = assemble(vehicle, Options(tmp_path / "state", (url,), wait=True))
        assembly.parts.after_tick(Output(RudderCommand(0.0, True), SNAPSHOT, ()), 1.0)
        content = find_status(tmp_path / "state", machine_s()).content
        assembly.close()
        assert listener.recv(2000) == b"$HCHDT,57.3,T*18\r\n"
    assert [link["url"] for link in content["links"]] == [url]


def test_close_ends_all_threads(vehicle, tmp_path):
    before = set(threading.enumerate())
    start(vehicle, tmp_path)
    assert set(threading.enumerate()) == before


def test_lost_mission_is_reported_at_start(vehicle, tmp_path, capfd):
    start(vehicle, tmp_path)
    (tmp_path / "state" / "mission.plan.0").write_bytes(bytes(4096))
    assembly = assemble(vehicle, Options(tmp_path / "state", wait=True))
    assembly.close()
    expected = "mission.plan.0 is damaged: there is no mission"
    assert [(event.severity, event.text) for event in assembly.parts.notices] == [(Severity.WARNING, expected)]
    assert expected in "".join(capfd.readouterr())


def test_start_messages_are_not_printed_twice(vehicle, tmp_path, capfd):
    arguments = argparse.Namespace(watchdog=None, wait=True)
    for _ in range(2):  # the first one ends without a record
        assembly = assemble(vehicle, Options(tmp_path / "state", wait=True))
        _supervise(assembly, arguments)
        for event in assembly.parts.notices:
            assembly.parts.print_event(event)
        assembly.close()
    expected = "Started again: cut off (the first time)"
    assert capfd.readouterr().err.count(expected) == 1
    assert [event.text for event in assembly.parts.notices].count(expected) == 1


def run_once(directory, vehicle, ending, after_s=1.0):
    """Start an autopilot and end it; return three of its parameters and its reports."""
    assembly = assemble(vehicle, Options(directory / "state", wait=True))
    supervision = _supervise(assembly, argparse.Namespace(watchdog=None, wait=True))
    assembly.parts.after_tick(None, assembly.parts.clock.now_s() + after_s)
    if ending == "fails":
        supervision.end_with_error("ValueError: math domain error")
    elif ending == "ends":
        supervision.end(restart=False)
    values = assembly.parts.autopilot.parameters()
    assembly.close()
    texts = [event.text for event in assembly.parts.notices]
    return [values[name] for name in ("CTL_K1", "MDL_K", "RUD_REVERSE")], texts


@pytest.fixture
def directory_with_parameters(vehicle, tmp_path, monkeypatch):
    """A state directory with other parameters than the vehicle file."""
    monkeypatch.setattr("firmware_py.assemble.wiring.report_status", lambda *_words: None)
    store = Store(tmp_path / "state")
    store.save("parameters.param", b"CTL_K1 55\nMDL_K 20\nRUD_REVERSE 1\n")
    store.close()
    return tmp_path


# CTL_K1, MDL_K, RUD_REVERSE
STORED, VEHICLE_FILE, BUILT_IN = [55.0, 20.0, 1.0], [41.0, 0.049, 1.0], [40.0, 0.049, 1.0]


def test_early_failures_replace_the_stored_steering_parameters(vehicle, directory_with_parameters):
    for expected in (STORED,) * 3 + (VEHICLE_FILE,) * 3 + (BUILT_IN,) * 4:
        values, texts = run_once(directory_with_parameters, vehicle, "fails")
        assert [round(value, 3) for value in values] == expected
    assert "9 starts failed: built-in steering parameters" in texts
    assert "Stored but not used: CTL_K1 55, MDL_K 20" in texts
    stored = StateFiles(directory_with_parameters / "state").load("parameters.param").decode()
    assert {"CTL_K1 55", "MDL_K 20", "RUD_REVERSE 1"} < set(stored.splitlines())


@pytest.mark.parametrize(("ending", "after_s"), [("ends", 1.0), ("fails", 61.0), ("is cut off", 61.0)])
def test_long_or_regular_run_resets_the_count_of_failed_starts(ending, after_s, vehicle, directory_with_parameters):
    for _ in range(2):
        run_once(directory_with_parameters, vehicle, "fails")
    run_once(directory_with_parameters, vehicle, ending, after_s)
    for _ in range(3):
        assert run_once(directory_with_parameters, vehicle, "fails")[0] == STORED
    assert run_once(directory_with_parameters, vehicle, "fails")[0] != STORED


def test_power_cuts_are_not_counted_as_failures(vehicle, directory_with_parameters):
    for _ in range(5):
        assert run_once(directory_with_parameters, vehicle, "is cut off")[0] == STORED


def test_early_watchdog_resets_are_counted_as_failures(vehicle, directory_with_parameters):
    for runs in range(4):
        (directory_with_parameters / "ended").write_text("2 watchdog killed ABRT\n")
        options = Options(directory_with_parameters / "state", wait=True, runtime=directory_with_parameters)
        assembly = assemble(vehicle, options)
        _supervise(assembly, argparse.Namespace(watchdog=None, wait=True))
        assert (assembly.parts.autopilot.parameters()["MDL_K"] == 20.0) == (runs < 3)
        assembly.close()


def test_console_prints_a_repeated_event_again(capfd):
    console = Console()
    console.print_early("it is so")
    for head in "abc":
        console.event(head, "it is so")
    console.close()
    assert capfd.readouterr().err == "it is so\nb it is so\nc it is so\n"


@pytest.mark.parametrize("number", range(4))
def test_failed_thread_start_is_one_line_and_releases_everything(number, vehicle, tmp_path, monkeypatch, capfd):
    """Console, store, log and file transfer have one each."""
    real, started = threading.Thread.start, []

    def start(thread):
        started.append(thread)
        if len(started) > number:
            raise RuntimeError("can't start new thread")
        real(thread)

    before = len(list(Path("/proc/self/fd").iterdir()))
    with monkeypatch.context() as patches:
        patches.setattr(threading.Thread, "start", start)
        assert main(["run", str(tmp_path / "boat.toml"), "--state", str(tmp_path / "state"), "--wait"]) == 2
    assert len(started) == number + 1
    lines = capfd.readouterr().err.splitlines()
    (line,) = (line for line in lines if not line.startswith("waiting for port "))
    assert "cannot start a thread" in line
    assert not any(thread.is_alive() for thread in started)
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    Store(tmp_path / "state").close()


def assemble_before_disk(vehicle, tmp_path, monkeypatch, key):
    """Start an autopilot whose state directory, with a signing key in it, is mounted later."""
    monkeypatch.setattr("firmware_py.system.store.RETRY_S", 0.01)
    disk = Store(tmp_path / "disk", private=(SIGNING_FILE,))
    disk.save(SIGNING_FILE, key, both_slots=True)
    disk.close()
    (tmp_path / "state").touch()  # a file instead of the directory
    return assemble(vehicle, Options(tmp_path / "state", wait=True))


def mount_disk(assembly, tmp_path):
    # Atomic, because the store would create a missing directory.
    (tmp_path / "link").symlink_to("disk")
    (tmp_path / "link").replace(tmp_path / "state")
    store = assembly.parts.store
    while store.failure:
        assert select.select([store.fileno()], [], [], 10.0)[0]
        store.service()


KEY = to_text(KeyRecord(bytes(32 * [7]), 10**13, {}))


@pytest.mark.parametrize(
    ("content", "active", "expected"),
    [
        (KEY, True, ["Signing key loaded and active"]),
        (b"rubbish", False, ["signing.key lost: what is stored is no signing key; set or remove the key"]),
        (b"", False, []),
    ],
)
def test_key_on_a_disk_mounted_late_is_used(content, active, expected, vehicle, tmp_path, monkeypatch):
    assembly = assemble_before_disk(vehicle, tmp_path, monkeypatch, content)
    notices_at_start = len(assembly.parts.notices)
    mount_disk(assembly, tmp_path)
    assert assembly.endpoint._signing.has_key is active
    assert bool(assembly.endpoint.key_problem) is (content == b"rubbish")
    texts = [event.text for event in assembly.parts.notices[notices_at_start:] if "igning" in event.text]
    assert [text[: len(start)] for text, start in zip(texts, expected, strict=True)] == expected
    assembly.close()


@pytest.mark.parametrize("other_key", [bytes(32 * [9]), None])
def test_key_set_or_removed_before_the_disk_is_mounted_is_kept(other_key, vehicle, tmp_path, monkeypatch):
    assembly = assemble_before_disk(vehicle, tmp_path, monkeypatch, KEY)
    signing = assembly.endpoint._signing
    if other_key:
        assert signing.set_key(other_key, 10**13)
    else:
        signing.remove_key()
    mount_disk(assembly, tmp_path)
    assembly.close()
    record = find_key(read_key(tmp_path / "state")).record
    assert (record and record.key) == other_key
    assert signing._key == other_key


@pytest.mark.parametrize(("host", "expected"), [("0.0.0.0", True), ("127.0.0.1", False)])
def test_open_link_is_reported_at_start(vehicle, tmp_path, host, expected):
    url = f"udpin:{host}:{unused_ports(['udpin'])[0]}"
    assembly = assemble(vehicle, Options(tmp_path / "state", (url,), wait=True))
    assembly.close()
    text = f"Open link: anyone on {url} can command; set a signing key"
    assert [event.text for event in assembly.parts.notices] == [text] * expected
