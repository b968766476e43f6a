"""The devices of a boat on ports of their own, read and steered by programs that the board knows nothing of."""

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

BENCH, FLOAT = [sys.executable, "-m", "hil"], [sys.executable, "-m", "firmware_py"]
BAUDS = {"compass": COMPASSES["nmea"].baud, "rudder": SERVOS["dynamixel"].baud, "position": POSITION.baud}

LATE_ANSWER_S = 0.02  # the driver waits for 41 ms, of which question and answer take 8

# The autopilot steers for 30 degrees from the start, without a ground station.
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
BOOT_MODE = 15
"""


def vehicle_file(path, ports, bauds):
    path.write_text(BOAT.format(**ports, **{f"{name}_baud": baud for name, baud in bauds.items()}))
    return str(path)


@pytest.fixture
def program(tmp_path):
    """Start programs that are gone after the test."""
    with ExitStack() as stack:
        yield lambda name, *command: stack.enter_context(
            closing(Program(name, command, tmp_path, env=without_pictures()))
        )


def listen_output(program, file, seconds=3):
    """Return the last line of `listen` of each device."""
    listener = program("listen", *FLOAT, "listen", file, "--json", "--seconds", str(seconds))
    listener.exit_code()
    return {line["device"]: line for line in map(json.loads, listener.text().splitlines())}


def test_any_program_can_read_and_steer_the_board(program, tmp_path):
    board = program("board", *BENCH, "board", str(tmp_path / "board"), "gusts", "--goal", "0:30")
    board.expect("Ctrl-C ends the run")
    devices = listen_output(program, str(tmp_path / "board" / "vehicle.toml"))
    assert {name for name, line in devices.items() if line["accepted"] > 0} == {"compass", "position", "rudder"}
    assert all(line["rejected"] == 0 for line in devices.values())
    ports = {name: tmp_path / "board" / name for name in BAUDS}
    file = vehicle_file(tmp_path / "boat.toml", ports, BAUDS)
    program("boat", *FLOAT, "run", file, "--state", str(tmp_path / "state"))
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
def test_devices_hang_on_adapters_whose_bus_is_half_duplex_and_echoes(servo_baud, program, tmp_path):
    """Every byte takes its time, and both ends hear what they say themselves.

    A servo answers within a millisecond. On a busy machine the emulated one, or the wire, may get no processor for
    longer than a reply is waited for: then the next question and that reply spoil each other, as they must.
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
        board = program("board", *BENCH, "board", str(tmp_path / "board"), "calm", "--vehicle", file, *words)
        board.expect("rudder: on the adapter")
        board.expect("Ctrl-C ends the run")
        devices = listen_output(program, file)
        assert {name for name, line in devices.items() if line["accepted"] > 0} == set(bauds)
        bad = {name: line["rejected"] for name, line in devices.items() if line["rejected"]}
        if (waited_s := wires["rudder"].before_collision_s) is None:
            assert bad == {}, devices
        else:
            assert set(bad) <= {"rudder"}, devices
            assert waited_s > LATE_ANSWER_S, "one talked into another's words"
        board.send_signal(signal.SIGTERM)
        assert board.exit_code() == 0


def sailed_over_wires(program, tmp_path, servo_baud, words):
    """Sail with an external autopilot at the far ends of the wires, with a TCP port."""
    bauds = {**BAUDS, "rudder": servo_baud}
    (port,) = unused_ports(["tcpin"])
    with ExitStack() as stack:
        for name, baud in bauds.items():
            ends = tmp_path / f"{name}.float", tmp_path / f"{name}.bench"
            stack.enter_context(Wire(*ends, baud, echo=name == "rudder", half_duplex=name == "rudder"))
        file = vehicle_file(tmp_path / "boat.toml", {name: tmp_path / f"{name}.float" for name in bauds}, bauds)
        link = ["--link", f"tcpin:127.0.0.1:{port}"]
        boat = program("boat", *FLOAT, "run", file, "--state", str(tmp_path / "state"), "--wait", *link)
        boat.wait_for(lambda: listening(port), "it does not listen")
        adapters = {"compass": "--compass-port", "rudder": "--servo-port", "position": "--position-port"}
        ports = [word for name in bauds for word in (adapters[name], str(tmp_path / f"{name}.bench"))]
        words = [*words, "--vehicle", file, "--remote", f"tcp:127.0.0.1:{port}", "--out", str(tmp_path / "out"), *ports]
        bench = program("bench", *BENCH, "run", *words)
        assert bench.exit_code(900.0) == 0, bench.text()
        return json.loads((tmp_path / "out" / "summary.json").read_text())


def listening(port):
    with closing(socket.socket()) as caller:
        return caller.connect_ex(("127.0.0.1", port)) == 0


@pytest.mark.proof
def test_an_autopilot_at_the_far_ends_of_the_wires_is_given_goals(program, tmp_path):
    summary = sailed_over_wires(program, tmp_path, 9600, ["calm", "--goal", "0:0,2:40", "--seconds", "7"])
    assert all(goal["accepted_s"] is not None for goal in summary["goals"])
    assert read(tmp_path / "out" / "truth.csv").rudder_rad.max() > 0.2


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("servo_baud", [57600, 9600])
def test_heading_keeping_over_wires_equals_that_over_ptys(servo_baud, program, tmp_path):
    """`pytest -m proof tests/process/test_board.py`: ten minutes of sea over bridged ptys with pacing and echo."""
    words = ["sea", "--goal", "0:0", "--seconds", "600"]
    wired = sailed_over_wires(program, tmp_path, servo_baud, words)["goals"][0]["rms_error_deg"]
    box = program("box", *BENCH, "run", *words, "--speed", "max", "--out", str(tmp_path / "box"))
    assert box.exit_code(300.0) == 0, box.text()
    boxed = json.loads((tmp_path / "box" / "summary.json").read_text())["goals"][0]["rms_error_deg"]
    print(f"{servo_baud} baud: {wired:.3f} deg rms over wires, {boxed:.3f} in the box")
    assert wired == pytest.approx(boxed, rel=0.05)


def test_an_adapter_that_is_not_there_is_named(program, tmp_path):
    board = program("board", *BENCH, "board", str(tmp_path / "board"), "--servo-port", str(tmp_path / "none"))
    assert board.exit_code() == 2
    assert "--servo-port" in board.text()
    assert len(board.text().splitlines()) == 1
