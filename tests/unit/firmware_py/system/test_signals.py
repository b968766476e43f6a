"""Signals that end the autopilot, and signals that do not."""

import os
import re
import signal

import pytest

from firmware_py.system.signals import TABLE, Action, Signals
from support.paths import ROOT

# signal(7): without a default action, not catchable, and after which the process cannot continue.
HARMLESS = {signal.SIGCHLD, signal.SIGCONT, signal.SIGURG, signal.SIGWINCH}
UNCATCHABLE = {signal.SIGKILL, signal.SIGSTOP}
FATAL = {signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT, signal.SIGSYS, signal.SIGTRAP}
REAL_TIME = range(signal.SIGRTMIN, signal.SIGRTMAX + 1)


@pytest.fixture(autouse=True)
def _restore_handlers():
    handlers = {number: signal.getsignal(number) for number in (*TABLE, *REAL_TIME)}
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)


def send(*numbers):
    """Send signals to this process; return whether the autopilot stops, and the texts of the events."""
    with Signals() as signals:
        for number in numbers:
            os.kill(os.getpid(), number)
        texts = [event.text for event in signals.take_events()]
        assert signals.take_events() == ()
    assert all(len(text) <= 50 for text in texts)
    return signals.is_stopping, texts


def signals_with(action):
    return pytest.mark.parametrize("number", [number for number, row_action in TABLE.items() if row_action is action])


def test_every_signal_that_would_end_or_stop_the_process_is_handled():
    assert set(signal.valid_signals()) - set(TABLE) - set(REAL_TIME) == HARMLESS | UNCATCHABLE | FATAL


@signals_with(Action.STOP)
def test_signals_that_end_the_autopilot(number):
    assert send(number, number) == (True, [f"{number.name}: autopilot ends, rudder centred"])
    assert signal.getsignal(number) is signal.SIG_IGN  # a late signal does not change the exit code


@signals_with(Action.CONTINUE)
def test_signals_without_a_use_are_reported_once(number):
    stopping, (text,) = send(number, number)
    assert not stopping
    assert text.startswith(f"{number.name}: ")
    assert text.endswith("autopilot continues")


def test_real_time_signals_are_ignored():
    assert send(*REAL_TIME)[0] is False
    assert send(signal.SIGRTMIN + 3)[1] == ["SIGRTMIN+3: not used; autopilot continues"]


def test_the_kernel_ignores_the_signals_of_a_terminal():
    # A handler would be called again at each attempt to write.
    with Signals():
        assert signal.getsignal(signal.SIGTTOU) is signal.SIG_IGN
        assert signal.getsignal(signal.SIGTTIN) is signal.SIG_IGN


def test_the_previous_handlers_are_restored():
    handlers = {number: signal.getsignal(number) for number in TABLE}
    send(signal.SIGHUP)
    assert {number: signal.getsignal(number) for number in TABLE} == handlers


def test_the_reference_page_lists_the_same_actions():
    page = (ROOT / "docs" / "reference" / "command-line.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (SIG[^|]*?) \| ([^|]*?) \|$", page, re.MULTILINE)
    actions = {name: text for names, text in rows for name in re.findall(r"SIG\w+", names)}
    for number, action in TABLE.items():
        assert actions[number.name].startswith(action.value), number.name
    numbers = {*TABLE, *HARMLESS, *UNCATCHABLE, *FATAL}
    assert actions.keys() - {"SIGRTMIN", "SIGRTMAX"} == {number.name for number in numbers}


def test_refused_suspension_has_its_reason():
    assert send(signal.SIGTSTP) == (False, ["SIGTSTP: suspending refused; autopilot continues"])
