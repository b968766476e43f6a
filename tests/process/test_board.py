"""`rambler-hil board`: simulated devices on ports, used by independent programs."""

import json
import signal
import socket
import sys
from contextlib import ExitStack, closing

import pytest

from hil.sim.device_factory import COMPASSES, POSITION, SERVOS
from hil.sim.truth import read
from support.harness import without_pictures
from support.program import Program, unused_ports
from support.wire import Wire

HARNESS, AUTOPILOT = [sys.executable, "-m", "hil"], [sys.executable, "-m", "firmware_py"]
BAUDS = {"compass": COMPASSES["nmea"].baud, "rudder": SERVOS["dynamixel"].baud, "position": POSITION.baud}

MAX_REPLY_DELAY_S = 0.02  # the driver waits for 41 ms, including 8 ms for request and reply

# The autopilot arms and steers from the start, without a ground station.
BOAT = """
[compass]
driver = "nmea"
port = "{compass}"
baud = {compass_baud}
[position]
driver = "nmea"
port = "{position}"
baud = {position_baud}
[rudder]
driver = "dynamixel"
port = "{rudder}"
baud = {rudder_baud}
[parameters]
BOOT_ARM = 1
BOOT_MODE = 15  # GUIDED
CLK_SET = 0
"""


def vehicle_file(path, ports, bauds):
    path.write_text(BOAT.format(**ports, **{f"{name}_baud": baud for name, baud in bauds.items()}))
    return str(path)


@pytest.fixture
def program(tmp_path):
    """Return a function that starts programs, which end with the test."""
    with ExitStack() as stack:
        yield lambda name, *command: stack.enter_context(
            closing(Program(name, command, tmp_path, env=without_pictures()))
        )


def listen_output(program, file, seconds=3):
    """Return the last line of `listen` of each device."""
    listener = program("listen", *AUTOPILOT, "listen", file, "--json", "--seconds", str(seconds))
    listener.exit_code()
    return {line["device"]: line for line in map(json.loads, listener.text().splitlines())}


def test_other_programs_read_and_steer_the_board(program, tmp_path):
    board = program("board", *HARNESS, "board", str(tmp_path / "board"), "gusts", "--goal", "0:30")
    board.expect("Ctrl-C ends the run")
    devices = listen_output(program, str(tmp_path / "board" / "vehicle.toml"))
    assert {name for name, line in devices.items() if line["accepted"] > 0} == {"compass", "position", "rudder"}
    assert all(line["rejected"] == 0 for line in devices.values())
    ports = {name: tmp_path / "board" / name for name in BAUDS}
    file = vehicle_file(tmp_path / "boat.toml", ports, BAUDS)
    program("boat", *AUTOPILOT, "run", file, "--state", str(tmp_path / "state"))
    board.expect(r"rudder +[+-](?!0\.0 )")
    board.send_signal(signal.SIGINT)
    assert board.exit_code() == 0
    assert f"report: {tmp_path / 'board' / 'report.html'}" in board.text()
    assert read(tmp_path / "board" / "truth.csv").rudder_rad.any()
    summary = json.loads((tmp_path / "board" / "summary.json").read_text())
    assert [goal["goal_deg"] for goal in summary["goals"]] == [30.0]
    assert summary["ending"] == "finished"
    assert 0.0 < summary["seconds"] < 1e4


@pytest.mark.proof
@pytest.mark.parametrize("servo_baud", [57600, 9600])
def test_devices_work_on_adapters_with_a_half_duplex_bus_and_echo(servo_baud, program, tmp_path):
    """Bytes have their transfer time, and both ends receive their own bytes.

    On a busy machine the emulated servo or the wire may be delayed for longer than the driver waits for a reply. The
    next request then collides with the reply, as on a real bus.
    """
    bauds = {**BAUDS, "rudder": servo_baud}
    wires = {}
    with ExitStack() as stack:
        for name, baud in bauds.items():
            ends = tmp_path / f"{name}.float", tmp_path / f"{name}.bench"
            wire = Wire(*ends, baud, echo=name == "rudder", half_duplex=name == "rudder")
            wires[name] = stack.enter_context(wire)
        file = vehicle_file(tmp_path / "boat.toml", {name: tmp_path / f"{name}.float" for name in bauds}, bauds)
        adapters = {"compass": "--compass-port", "rudder": "--servo-port", "position": "--position-port"}
        words = [word for name in bauds for word in (adapters[name], str(tmp_path / f"{name}.bench"))]
        board = program("board", *HARNESS, "board", str(tmp_path / "board"), "calm", "--vehicle", file, *words)
        board.expect("rudder: on the adapter")
        board.expect("Ctrl-C ends the run")
        devices = listen_output(program, file)
        assert {name for name, line in devices.items() if line["accepted"] > 0} == set(bauds)
        rejected = {name: line["rejected"] for name, line in devices.items() if line["rejected"]}
        if (delay_s := wires["rudder"].before_collision_s) is None:
            assert rejected == {}, devices
        else:
            assert set(rejected) <= {"rudder"}, devices
            assert delay_s > MAX_REPLY_DELAY_S, "a collision without a delayed reply"
        board.send_signal(signal.SIGTERM)
        assert board.exit_code() == 0


def run_over_wires(program, tmp_path, servo_baud, words):
    """Run with an external autopilot at the far ends of the wires, commanded over TCP; return the summary."""
    bauds = {**BAUDS, "rudder": servo_baud}
    (port,) = unused_ports(["tcpin"])
    with ExitStack() as stack:
        for name, baud in bauds.items():
            ends = tmp_path / f"{name}.float", tmp_path / f"{name}.bench"
            stack.enter_context(Wire(*ends, baud, echo=name == "rudder", half_duplex=name == "rudder"))
        file = vehicle_file(tmp_path / "boat.toml", {name: tmp_path / f"{name}.float" for name in bauds}, bauds)
        link = ["--link", f"tcpin:127.0.0.1:{port}"]
        boat = program("boat", *AUTOPILOT, "run", file, "--state", str(tmp_path / "state"), "--wait", *link)
        boat.wait_for(lambda: is_listening(port), "the autopilot does not listen")
        adapters = {"compass": "--compass-port", "rudder": "--servo-port", "position": "--position-port"}
        ports = [word for name in bauds for word in (adapters[name], str(tmp_path / f"{name}.bench"))]
        words = [*words, "--vehicle", file, "--remote", f"tcp:127.0.0.1:{port}", "--out", str(tmp_path / "out"), *ports]
        bench = program("bench", *HARNESS, "run", *words)
        assert bench.exit_code(900.0) == 0, bench.text()
        return json.loads((tmp_path / "out" / "summary.json").read_text())


def is_listening(port):
    with closing(socket.socket()) as client:
        return client.connect_ex(("127.0.0.1", port)) == 0


@pytest.mark.proof
def test_autopilot_at_the_far_ends_of_the_wires_accepts_goals(program, tmp_path):
    summary = run_over_wires(program, tmp_path, 9600, ["calm", "--goal", "0:0,2:40", "--seconds", "7"])
    assert all(goal["accepted_s"] is not None for goal in summary["goals"])
    assert read(tmp_path / "out" / "truth.csv").rudder_rad.max() > 0.2


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("servo_baud", [57600, 9600])
def test_heading_keeping_over_wires_equals_that_over_ptys(servo_baud, program, tmp_path):
    """`pytest -m proof tests/process/test_board.py`: ten minutes over wires with transfer times and echo."""
    words = ["sea", "--goal", "0:0", "--seconds", "600"]
    wire_rms_deg = run_over_wires(program, tmp_path, servo_baud, words)["goals"][0]["rms_error_deg"]
    reference = program("box", *HARNESS, "run", *words, "--speed", "max", "--out", str(tmp_path / "box"))
    assert reference.exit_code(300.0) == 0, reference.text()
    pty_rms_deg = json.loads((tmp_path / "box" / "summary.json").read_text())["goals"][0]["rms_error_deg"]
    print(f"{servo_baud} baud: {wire_rms_deg:.3f} deg rms over wires, {pty_rms_deg:.3f} over ptys")
    assert wire_rms_deg == pytest.approx(pty_rms_deg, rel=0.05)


def test_missing_adapter_is_a_one_line_error(program, tmp_path):
    board = program("board", *HARNESS, "board", str(tmp_path / "board"), "--servo-port", str(tmp_path / "none"))
    assert board.exit_code() == 2
    assert "--servo-port" in board.text()
    assert len(board.text().splitlines()) == 1
