"""What is wired at a start: parameters from the vehicle file and the state directory."""

import argparse
import select
import threading
from pathlib import Path

import pytest

from firmware_py.__main__ import main
from firmware_py.assemble.wiring import Options, assemble, vehicle_parameters
from firmware_py.cli.run import _supervise
from firmware_py.common.records import Severity
from firmware_py.link.signing import KeyRecord, find_key, to_text
from firmware_py.system.console import Console
from firmware_py.system.state_directory import SIGNING_FILE, StateFiles, stored_key
from firmware_py.system.store import Store
from firmware_py.vehicle import load
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
    """Wire an autopilot, end it, and return the parameters that it had."""
    assembly = assemble(vehicle, Options(directory / "state", wait=True))
    values = assembly.parts.autopilot.parameters()
    assembly.close()
    return values


def test_starts_are_counted_and_no_file_sets_the_count(vehicle, tmp_path):
    assert vehicle_parameters(vehicle)["STAT_BOOTCNT"] == 0.0
    assert [start(vehicle, tmp_path)["STAT_BOOTCNT"] for _ in range(3)] == [1.0, 2.0, 3.0]
    assert start(vehicle, tmp_path)["CTL_K1"] == 41.0


def test_ground_stations_see_logs_and_uploads_of_the_state_directory(vehicle, tmp_path):
    assembly = assemble(vehicle, Options(tmp_path / "state", wait=True))
    try:
        tree = assembly.endpoint._services.tree
        assert {name: area.writable for name, area in tree.areas.items()} == {"logs": False, "uploads": True}
        assert assembly.endpoint.descriptors()  # that of the thread that waits for the disk
    finally:
        assembly.close()


def test_closing_ends_all_threads(vehicle, tmp_path):
    before = set(threading.enumerate())
    start(vehicle, tmp_path)
    assert set(threading.enumerate()) == before


def test_a_mission_that_was_lost_is_an_event_of_the_start(vehicle, tmp_path, capfd):
    start(vehicle, tmp_path)
    (tmp_path / "state" / "mission.plan.0").write_bytes(bytes(4096))
    assembly = assemble(vehicle, Options(tmp_path / "state", wait=True))
    assembly.close()
    reported = "mission.plan.0 is damaged: there is no mission"
    assert [(event.severity, event.text) for event in assembly.parts.notices] == [(Severity.WARNING, reported)]
    assert reported in "".join(capfd.readouterr())


def test_start_messages_are_not_printed_twice(vehicle, tmp_path, capfd):
    arguments = argparse.Namespace(watchdog=None, wait=True)
    for _ in range(2):  # the first one is cut off
        assembly = assemble(vehicle, Options(tmp_path / "state", wait=True))
        _supervise(assembly, arguments)
        for event in assembly.parts.notices:
            assembly.parts.print_event(event)
        assembly.close()
    reported = "Started again: cut off (the first time)"
    assert capfd.readouterr().err.count(reported) == 1
    assert [event.text for event in assembly.parts.notices].count(reported) == 1


def begun(directory, vehicle, how, after_s=1.0):
    """Start an autopilot and end it so; return the parameters that it had and what it reported."""
    assembly = assemble(vehicle, Options(directory / "state", wait=True))
    supervision = _supervise(assembly, argparse.Namespace(watchdog=None, wait=True))
    assembly.parts.after_tick(None, assembly.parts.clock.now_s() + after_s)
    if how == "fails":
        supervision.end_with_error("ValueError: math domain error")
    elif how == "ends":
        supervision.end(restart=False)
    values = assembly.parts.autopilot.parameters()
    assembly.close()
    return [values[name] for name in ("CTL_K1", "MDL_K", "RUD_REVERSE")], [e.text for e in assembly.parts.notices]


@pytest.fixture
def misled(vehicle, tmp_path, monkeypatch):
    """A boat whose operator has set what its vehicle file has otherwise."""
    monkeypatch.setattr("firmware_py.assemble.wiring.report_status", lambda *_words: None)
    store = Store(tmp_path / "state")
    store.save("parameters.param", b"CTL_K1 55\nMDL_K 20\nRUD_REVERSE 1\n")
    store.close()
    return tmp_path


STORED, OF_VEHICLE, BUILT_IN = [55.0, 20.0, 1.0], [41.0, 0.049, 1.0], [40.0, 0.049, 1.0]


def test_after_three_early_failures_control_starts_with_the_parameters_of_the_vehicle_file(vehicle, misled):
    for expected in (STORED,) * 3 + (OF_VEHICLE,) * 3 + (BUILT_IN,) * 4:
        values, texts = begun(misled, vehicle, "fails")
        assert [round(value, 3) for value in values] == expected
    assert "9 starts failed: built-in steering parameters" in texts
    assert "Stored but not used: CTL_K1 55, MDL_K 20" in texts
    kept = StateFiles(misled / "state").load("parameters.param").decode()
    assert {"CTL_K1 55", "MDL_K 20", "RUD_REVERSE 1"} < set(kept.splitlines())


@pytest.mark.parametrize(("how", "after_s"), [("ends", 1.0), ("fails", 61.0), ("is cut off", 61.0)])
def test_a_long_or_regular_run_resets_the_count_of_failed_starts(how, after_s, vehicle, misled):
    for _ in range(2):
        begun(misled, vehicle, "fails")
    begun(misled, vehicle, how, after_s)
    for _ in range(3):
        assert begun(misled, vehicle, "fails")[0] == STORED
    assert begun(misled, vehicle, "fails")[0] != STORED


def test_power_cuts_are_no_failures(vehicle, misled):
    for _ in range(5):
        assert begun(misled, vehicle, "is cut off")[0] == STORED


def test_early_watchdog_resets_count_as_failed_starts(vehicle, misled):
    for runs in range(4):
        (misled / "ended").write_text("2 watchdog killed ABRT\n")
        options = Options(misled / "state", wait=True, runtime=misled)
        assembly = assemble(vehicle, options)
        _supervise(assembly, argparse.Namespace(watchdog=None, wait=True))
        assert (assembly.parts.autopilot.parameters()["MDL_K"] == 20.0) == (runs < 3)
        assembly.close()


def test_what_happens_again_is_shown_again(capfd):
    console = Console()
    console.ahead("it is so")
    for head in "abc":
        console.event(head, "it is so")
    console.close()
    assert capfd.readouterr().err == "it is so\nb it is so\nc it is so\n"


@pytest.mark.parametrize("number", range(4))
def test_a_failed_thread_start_is_one_line_and_releases_everything(number, vehicle, tmp_path, monkeypatch, capfd):
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
    (line,) = capfd.readouterr().err.splitlines()
    assert "cannot start a thread" in line
    assert not any(thread.is_alive() for thread in started)
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    Store(tmp_path / "state").close()


def assembled_before_its_disk(vehicle, tmp_path, monkeypatch, key):
    """Wire an autopilot whose state directory comes later, with a key in it."""
    monkeypatch.setattr("firmware_py.system.store.RETRY_S", 0.01)
    kept = Store(tmp_path / "kept", private=(SIGNING_FILE,))
    kept.save(SIGNING_FILE, key, both_slots=True)
    kept.close()
    (tmp_path / "state").touch()  # in the way
    return assemble(vehicle, Options(tmp_path / "state", wait=True))


def let_arrive(assembly, tmp_path):
    # In one step: with nothing in its way the store would make the directory itself.
    (tmp_path / "link").symlink_to("kept")
    (tmp_path / "link").replace(tmp_path / "state")
    store = assembly.parts.store
    while store.failure:
        assert select.select([store.fileno()], [], [], 10.0)[0]
        store.service()


KEY = to_text(KeyRecord(bytes(32 * [7]), 10**13, {}))


@pytest.mark.parametrize(
    ("content", "active", "reported"),
    [
        (KEY, True, ["Signing key loaded and active"]),
        (b"rubbish", False, ["signing.key lost: what is stored is no signing key; set or remove the key"]),
        (b"", False, []),
    ],
)
def test_a_key_on_a_disk_mounted_late_is_used(content, active, reported, vehicle, tmp_path, monkeypatch):
    assembly = assembled_before_its_disk(vehicle, tmp_path, monkeypatch, content)
    at_start = len(assembly.parts.notices)
    let_arrive(assembly, tmp_path)
    assert assembly.endpoint._signing.active is active
    assert bool(assembly.endpoint.key_problem) is (content == b"rubbish")
    texts = [event.text for event in assembly.parts.notices[at_start:] if "igning" in event.text]
    assert [text[: len(start)] for text, start in zip(texts, reported, strict=True)] == reported
    assembly.close()


@pytest.mark.parametrize("another", [bytes(32 * [9]), None])
def test_a_key_set_or_removed_before_the_disk_is_mounted_stays(another, vehicle, tmp_path, monkeypatch):
    assembly = assembled_before_its_disk(vehicle, tmp_path, monkeypatch, KEY)
    signing = assembly.endpoint._signing
    if another:
        assert signing.set_key(another, 10**13)
    else:
        signing.remove_key()
    let_arrive(assembly, tmp_path)
    assembly.close()
    record = find_key(stored_key(tmp_path / "state")).record
    assert (record and record.key) == another
    assert signing._key == another


@pytest.mark.parametrize(("host", "reported"), [("0.0.0.0", True), ("127.0.0.1", False)])
def test_an_open_link_is_reported_at_start(vehicle, tmp_path, host, reported):
    url = f"udpin:{host}:{unused_ports(['udpin'])[0]}"
    assembly = assemble(vehicle, Options(tmp_path / "state", (url,), wait=True))
    assembly.close()
    text = f"Open link: anyone on {url} can command; set a signing key"
    assert [event.text for event in assembly.parts.notices] == [text] * reported
