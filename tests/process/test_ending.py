"""End of the autopilot: signals, blocked or closed terminals, a rudder that is not centred."""

import math
import os
import signal
import subprocess
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

REBOOT, FORCE = 246, 20190226.0  # MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN; ArduPilot's number for a reboot while armed
GUIDED = 15
TURN_GOALS = "0:0,6:90"  # the rudder reaches its limit
TIMEOUT_S = 30.0
AMIDSHIPS_DEG = 1.2
SLEW_DEG_S = 30.0  # of the emulated shaft
CRASHING_PROGRAM = (
    "import sys, firmware_py.loop as loop; from firmware_py.__main__ import main\n"
    "def fail(*_): raise RuntimeError('made for a test')\n"
    "loop._tick = fail; sys.exit(main())"
)
# Sends a signal during the imports of the program.
PROGRAM_WITH_EARLY_SIGNAL = (
    "import importlib, os, signal, sys; from firmware_py.__main__ import main; really = importlib.import_module\n"
    "def texts(*words): os.kill(os.getpid(), signal.SIG{name}); return really(*words)\n"
    "importlib.import_module = texts; sys.exit(main())"
)


@pytest.fixture
def launch(monkeypatch):
    """Return a function that sets output, redirections and Python arguments of the autopilots started later."""

    def set_up(descriptor=None, redirections="", python=None):
        start_process = subprocess.Popen

        def popen(words, **options):
            words = list(words) if python is None else [words[0], *python, *words[3:]]
            if descriptor is not None:
                options |= {"stdout": descriptor, "stderr": descriptor}
            options["env"] = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
            return start_process(["sh", "-c", f'exec "$@" {redirections}', "sh", *words], **options)

        monkeypatch.setattr(subprocess, "Popen", popen)

    return set_up


@pytest.fixture
def pipe():
    with ExitStack() as stack:
        yield [
            stack.enter_context(os.fdopen(end, mode, buffering=0))
            for end, mode in zip(os.pipe(), ("rb", "wb"), strict=True)
        ]


@pytest.fixture
def blocked_pipe(pipe):
    """The write end of a full pipe that is not read."""
    os.set_blocking(pipe[1].fileno(), False)
    while pipe[1].write(b"-" * 4096) is not None:
        pass
    os.set_blocking(pipe[1].fileno(), True)
    return pipe[1]


@pytest.fixture
def broken_pipe(pipe):
    pipe[0].close()
    return pipe[1]


@pytest.fixture
def boat(make_boat):
    """A boat that steers."""
    boat = make_boat()
    boat.start()
    boat.get_under_way(GUIDED)
    return boat


def pid_of(boat):
    return boat.process._process.pid


def handles_signals(pid):
    status = Path(f"/proc/{pid}/status").read_text()
    caught = next(int(line.split()[1], 16) for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(caught >> (signal.SIGTERM - 1) & 1)


def run_into_turn(boat):
    boat.start()
    boat.get_under_way(GUIDED)
    boat.run(12.0 - boat.now_s)
    assert abs(boat.rudder_deg()) > 15.0
    return boat


def wait_for_end(boat):
    """Wait for the end; return the exit code and the duration by the clock of the boat."""
    start_s = boat.now_s
    boat.time.run_out(boat.board, boat.process)
    assert boat.process.wait(TIMEOUT_S)
    return boat.process.exit_code(), boat.now_s - start_s


def restart(boat):
    """Order a restart and wait until the program has replaced itself."""
    boat.send_command(REBOOT, 1.0, 0.0, 0.0, 0.0, 0.0, FORCE)
    while boat.server.serve():
        pass


@pytest.mark.parametrize(
    "kind", ["closed", *(pytest.param(kind, marks=pytest.mark.proof) for kind in ("blocked", "full", "broken"))]
)
def test_blocked_or_broken_output_does_not_affect_run_restart_and_end(make_boat, launch, request, kind):
    if kind in ("broken", "blocked"):
        launch(request.getfixturevalue(f"{kind}_pipe"))
    else:
        launch(redirections={"closed": "<&- >&- 2>&-", "full": ">/dev/full 2>/dev/full"}[kind])
    boat = make_boat(goals="0:0")
    boat.start()
    boat.get_under_way(GUIDED)
    restart(boat)
    boat.time.begin(boat.board, boat.process)
    boat.run(5.0)
    streams = [str(Path(f"/proc/{pid_of(boat)}/fd/{number}").readlink()) for number in range(3)]
    assert not any("pts" in path or "socket" in path for path in streams)
    if kind == "closed":
        assert streams == ["/dev/null"] * 3
    boat.finish()


def test_internal_error_centres_the_rudder_although_the_output_is_blocked(make_boat, launch, blocked_pipe):
    launch(blocked_pipe, python=["-c", CRASHING_PROGRAM])
    boat = make_boat()
    deflect_rudder(boat)
    boat.start()
    assert wait_for_end(boat)[0] == 1
    assert abs(boat.rudder_deg()) < AMIDSHIPS_DEG


def test_ignored_signals_neither_end_nor_stop_the_autopilot(boat):
    for name in ("HUP", "TSTP", "USR1", "USR2", "ALRM", "IO", "PWR", "PIPE", "TTIN", "TTOU", "HUP", "TSTP"):
        os.kill(pid_of(boat), getattr(signal, f"SIG{name}"))
        boat.run(0.5)
    texts = [text for text in boat.texts_since(0.0) if text.endswith("autopilot continues")]
    names = "SIGHUP SIGTSTP SIGUSR1 SIGUSR2 SIGALRM SIGIO SIGPWR"
    assert [text.split(":")[0] for text in texts] == names.split()
    assert texts[0] in boat.output_text()
    boat.finish()


def test_last_tick_has_the_reason_of_the_end_unless_killed(boat):
    text = "SIGTERM: autopilot ends, rudder centred"
    boat.kill()
    assert text.encode() not in boat.logs()[-1].read_bytes()
    boat.start()
    boat.run(3.0)
    (*_, log) = boat.finish()
    assert text.encode() in log.read_bytes()
    assert text in boat.output_text()
    assert boat.texts_since(0.0)[-1] == text


@pytest.mark.parametrize(("servo", "signals"), [("dynamixel", [signal.SIGTERM]), ("volz", [signal.SIGQUIT] * 2)])
def test_end_waits_until_the_rudder_is_centred_and_no_longer(make_boat, servo, signals):
    boat = run_into_turn(make_boat(goals=TURN_GOALS, servo=servo))
    initial_deg = abs(boat.rudder_deg())
    for number in signals:
        os.kill(pid_of(boat), number)
    code, duration_s = wait_for_end(boat)
    assert code == 0
    assert abs(boat.rudder_deg()) < AMIDSHIPS_DEG
    assert duration_s < initial_deg / SLEW_DEG_S + 0.35  # two readings a tenth of a second apart


def test_end_waits_two_seconds_for_a_silent_servo(make_boat):
    boat = run_into_turn(make_boat(goals=TURN_GOALS))
    boat.lines["rudder"].unplug()
    boat.process.terminate()
    code, duration_s = wait_for_end(boat)
    assert code == 0
    assert 1.9 < duration_s < 2.3


def test_signal_during_a_restart_ends_the_autopilot_normally(boat):
    restart(boat)
    os.kill(pid_of(boat), signal.SIGHUP)
    boat.process.terminate()
    boat.time.begin(boat.board, boat.process)
    assert wait_for_end(boat)[0] == 0


def deflect_rudder(boat):
    """Deflect the rudder, as a killed process may leave it."""
    boat.world.shaft.set_torque(on=True)
    boat.world.shaft.set_target(math.radians(25.0))
    boat.world.advance_to(2.0)
    assert boat.rudder_deg() > 20.0


def test_signal_before_the_first_tick_centres_the_rudder(make_boat, monkeypatch):
    boat = make_boat()
    deflect_rudder(boat)
    accept = boat.time.begin

    def begin(board, process):
        give_up_s = time.monotonic() + TIMEOUT_S
        while not handles_signals(pid_of(boat)):  # lockstep: the clock of the boat waits for `begin`
            assert time.monotonic() < give_up_s
            time.sleep(0.01)
        process.terminate()
        accept(board, process)

    monkeypatch.setattr(boat.time, "begin", begin)
    boat.start()
    assert wait_for_end(boat)[0] == 0
    assert abs(boat.rudder_deg()) < AMIDSHIPS_DEG


@pytest.mark.parametrize("name", ["TERM", pytest.param("INT", marks=pytest.mark.proof)])
def test_signal_during_the_imports_centres_the_rudder(make_boat, launch, name):
    launch(python=["-c", PROGRAM_WITH_EARLY_SIGNAL.format(name=name)])
    boat = make_boat()
    deflect_rudder(boat)
    boat.start()
    assert wait_for_end(boat)[0] == 0
    assert abs(boat.rudder_deg()) < AMIDSHIPS_DEG
