"""`rambler run`: exit codes, errors at the start, and the end of the control loop."""

import argparse
from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_py.cli import run as command
from firmware_py.core.liveness import StuckError
from firmware_py.system.clock import ClockError
from firmware_py.vehicle import VehicleError

RESTART, SHUT_DOWN = SimpleNamespace(shutdown=False), SimpleNamespace(shutdown=True)


class FakeSignals:
    """Signals of a process; `calls` are those of this object and of the functions that tests replace."""

    def __init__(self, calls, *, is_stopping=False):
        self.calls, self.is_stopping, self.take_events = calls, is_stopping, "events"

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        pass

    def block(self):
        self.calls.append("block")


@pytest.fixture
def calls():
    return []


@pytest.fixture
def signals(monkeypatch, calls):
    signals = FakeSignals(calls)
    monkeypatch.setattr(command, "Signals", lambda: signals)
    return signals


@pytest.fixture
def assembly(monkeypatch, calls):
    """A fake assembly, which `run` supervises; the control loop is not run."""
    parts = SimpleNamespace(autopilot=SimpleNamespace(restart=None))
    console = SimpleNamespace(line=calls.append)
    assembly = SimpleNamespace(parts=parts, console=console, close=lambda: calls.append("close"))
    monkeypatch.setattr(command, "load", lambda _path: SimpleNamespace(name="Boat 1"))
    monkeypatch.setattr(command, "_supervise", lambda *_words: "supervision")
    monkeypatch.setattr(command.realtime, "restart_program", lambda: calls.append("restart"))

    def assemble(_vehicle, options):
        assembly.options = options
        return assembly

    monkeypatch.setattr(command, "assemble", assemble)
    return assembly


def arguments(**changes):
    values = {"vehicle": Path("boat.toml"), "state": Path("/nowhere/state"), "link": ["a", "b"], "wait": False}
    values |= {"watchdog": None, "lockstep": None, "status": False, "with_parent": None}
    return argparse.Namespace(**values | changes)


@pytest.mark.parametrize(
    ("loop_code", "restart", "is_stopping", "code", "later_calls"),
    [
        (0, None, False, 0, []),
        (1, SHUT_DOWN, False, 1, []),
        (0, SHUT_DOWN, False, 10, []),
        (0, SHUT_DOWN, True, 0, []),
        (0, RESTART, True, 0, []),
        (0, RESTART, False, 10, ["block", "restart"]),  # restart_program does not return
    ],
)
def test_exit_code_names_a_shut_down_and_a_restart_replaces_the_process(
    signals, assembly, monkeypatch, calls, loop_code, restart, is_stopping, code, later_calls
):
    monkeypatch.setattr(command, "_run_loop", lambda *_words, real_time: loop_code if real_time else 99)
    assembly.parts.autopilot.restart, signals.is_stopping = restart, is_stopping
    assert command.run(arguments()) == code
    assert calls[0].endswith("Boat 1, state in /nowhere/state")
    assert calls[1:] == later_calls


@pytest.mark.parametrize(
    ("changes", "may_set_clock"), [({}, True), ({"lockstep": "socket"}, False), ({"with_parent": 7}, False)]
)
def test_clock_is_set_only_outside_the_harness(signals, assembly, monkeypatch, changes, may_set_clock):
    monkeypatch.setattr(command, "_run_loop", lambda *_words, real_time: int(real_time))
    monkeypatch.setattr(command.realtime, "end_with_parent", lambda parent: parent == 7)
    assert command.run(arguments(**changes)) == int("lockstep" not in changes)
    options = assembly.options
    assert (options.may_set_clock, options.link_urls, options.wait) == (may_set_clock, ("a", "b"), False)


def test_program_of_an_ended_parent_does_not_start(signals, assembly, monkeypatch):
    monkeypatch.setattr(command.realtime, "end_with_parent", lambda _parent: False)
    assert command.run(arguments(with_parent=7)) == 0
    assert not hasattr(assembly, "options")


@pytest.mark.parametrize(("is_present", "delay_s"), [(True, 5.0), (False, 0.0)])
def test_failed_start_is_delayed_under_a_service_manager(signals, monkeypatch, capsys, is_present, delay_s):
    def fail(_path):
        raise VehicleError("no such vehicle file")

    now_s, reasons = [100.0], []
    manager = SimpleNamespace(is_present=is_present, notify_status=reasons.append)
    monkeypatch.setattr(command, "load", fail)
    monkeypatch.setattr(command, "ServiceManager", lambda _environment: manager)

    def sleep(seconds):
        now_s[0] += seconds
        assert seconds == 0.1
        assert now_s[0] < 120.0, "it does not end"

    monkeypatch.setattr(command, "time", SimpleNamespace(monotonic=lambda: now_s[0], sleep=sleep))
    assert command.run(arguments()) == 2
    assert capsys.readouterr().err == "rambler run: no such vehicle file\n"
    assert reasons == ["no such vehicle file"]
    assert now_s[0] - 100.0 == pytest.approx(delay_s, abs=0.11)
    signals.is_stopping, now_s[0] = True, 100.0
    assert (command.run(arguments()), now_s[0]) == (2, 100.0)


@pytest.mark.parametrize(
    ("wait", "user", "owner_uid", "is_refused"),
    [(False, 0, 1000, True), (False, 0, 0, False), (False, 1000, 0, False), (True, 0, 1000, False)],
)
def test_root_does_not_use_the_state_of_another_user(
    signals, assembly, monkeypatch, capsys, wait, user, owner_uid, is_refused
):
    class Directory:
        def stat(self):
            return SimpleNamespace(st_uid=owner_uid)

    monkeypatch.setattr(command.os, "geteuid", lambda: user)
    monkeypatch.setattr(command, "_run_loop", lambda *_words, real_time: 0)
    monkeypatch.setattr(command, "_delay_exit", lambda *_words: None)
    assert command.run(arguments(state=Directory(), wait=wait)) == (2 if is_refused else 0)
    assert ("belongs to user" in capsys.readouterr().err) is is_refused


@pytest.mark.parametrize(
    ("error", "restart", "is_stopping", "code", "expected"),
    [
        (None, None, False, 0, [("end", False)]),
        (None, RESTART, False, 0, [("end", True)]),
        (None, RESTART, True, 0, [("end", False)]),
        (None, SHUT_DOWN, False, 0, [("end", False)]),
        (ClockError("no lockstep"), None, False, 1, ["rambler run: no lockstep"]),
        (ClockError("no lockstep"), None, True, 0, ["rambler run: no lockstep"]),
        (ValueError("bad"), None, False, 1, ["Traceback (most recent call last):", ("error", "ValueError: bad")]),
        (StuckError("stuck"), None, False, 11,
         [("error", "stuck"), "rambler run: stuck; rudder safe, restarting", ("wait", 2.0)]),
    ],
)  # fmt: skip
def test_end_of_the_loop_is_recorded(monkeypatch, signals, calls, error, restart, is_stopping, code, expected):
    def run_loop(_parts, is_stopping):
        calls.append(is_stopping())
        if error is not None:
            raise error

    def exit_now(exit_code):
        calls.append("exit")
        raise SystemExit(exit_code)

    def make_thread(target, *, daemon):
        return SimpleNamespace(start=target, join=lambda wait_s: calls.append(("wait", wait_s)) if daemon else None)

    supervision = SimpleNamespace(
        end=lambda *, restart: calls.append(("end", restart)), end_with_error=lambda text: calls.append(("error", text))
    )
    signals.is_stopping = is_stopping
    parts = SimpleNamespace(autopilot=SimpleNamespace(restart=restart))
    assembly = SimpleNamespace(
        parts=parts, console=SimpleNamespace(line=calls.append), close=lambda: calls.append("close")
    )
    monkeypatch.setattr(command, "run_loop", run_loop)
    monkeypatch.setattr(command.os, "_exit", exit_now)
    monkeypatch.setattr(command, "threading", SimpleNamespace(Thread=make_thread))
    monkeypatch.setattr(command.realtime, "prepare", lambda ordinary, *, real_time: [f"{ordinary} {real_time}"])
    try:
        result = command._run_loop(assembly, supervision, signals, real_time=True)
    except SystemExit as exit_info:
        result = exit_info.code
    assert result == code
    assert calls[:2] == ["('link files',) True", is_stopping]
    ends = {"close", "exit"}
    remaining = [call for call in calls[2:] if call not in ends and not str(call).startswith(("  ", "ValueError"))]
    assert remaining == expected
    assert "close" in calls
    assert parts.signal_events == "events"
