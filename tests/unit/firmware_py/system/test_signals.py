"""Which signals end an autopilot and which do not."""

import os
import re
import signal

import pytest

from firmware_py.system.signals import TABLE, Action, Signals
from support.paths import ROOT

# signal(7): these do nothing by themselves, these cannot be caught, and behind these there is nothing to go on with.
HARMLESS = {signal.SIGCHLD, signal.SIGCONT, signal.SIGURG, signal.SIGWINCH}
BEYOND = {signal.SIGKILL, signal.SIGSTOP}
FATAL = {signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT, signal.SIGSYS, signal.SIGTRAP}
REAL_TIME = range(signal.SIGRTMIN, signal.SIGRTMAX + 1)


@pytest.fixture(autouse=True)
def _given_back():
    before = {number: signal.getsignal(number) for number in (*TABLE, *REAL_TIME)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def sent(*numbers):
    """Send signals to this process, which takes them as an autopilot does."""
    with Signals() as signals:
        for number in numbers:
            os.kill(os.getpid(), number)
        texts = [event.text for event in signals.take_events()]
        assert signals.take_events() == ()
    return signals.stopping, texts


def test_every_signal_that_would_end_or_stop_the_process_is_handled():
    assert set(signal.valid_signals()) - set(TABLE) - set(REAL_TIME) == HARMLESS | BEYOND | FATAL


@pytest.mark.parametrize("number", [number for number, act in TABLE.items() if act is Action.STOP])
def test_signals_that_end_the_autopilot(number):
    stopping, (text,) = sent(number, number)
    assert stopping
    assert text == f"{number.name}: autopilot ends, rudder centred"
    assert len(text) <= 50
    assert signal.getsignal(number) is signal.SIG_IGN  # one that comes late does not change the exit code


@pytest.mark.parametrize("number", [number for number, act in TABLE.items() if act is Action.CONTINUE])
def test_signals_without_a_use_are_reported_once(number):
    stopping, (text,) = sent(number, number)
    assert not stopping
    assert text.startswith(f"{number.name}: ")
    assert text.endswith("autopilot continues")
    assert len(text) <= 50


def test_real_time_signals_are_ignored():
    assert sent(*REAL_TIME)[0] is False
    assert sent(signal.SIGRTMIN + 3)[1] == ["SIGRTMIN+3: not used; autopilot continues"]


def test_a_terminal_cannot_stop_the_autopilot():
    # A handler would be called again at each attempt to write.
    with Signals():
        assert signal.getsignal(signal.SIGTTOU) is signal.SIG_IGN
        assert signal.getsignal(signal.SIGTTIN) is signal.SIG_IGN


def test_the_previous_handlers_are_restored():
    before = {number: signal.getsignal(number) for number in TABLE}
    sent(signal.SIGHUP)
    assert {number: signal.getsignal(number) for number in TABLE} == before


def test_the_reference_says_the_same():
    page = (ROOT / "docs" / "reference" / "command-line.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (SIG[^|]*?) \| ([^|]*?) \|$", page, re.MULTILINE)
    effects = {name: text for names, text in rows for name in re.findall(r"SIG\w+", names)}
    for number, act in TABLE.items():
        assert effects[number.name].startswith(act.value), number.name
    assert {name for name in effects if name not in ("SIGRTMIN", "SIGRTMAX")} == {
        number.name for number in {*TABLE, *HARMLESS, *BEYOND, *FATAL}
    }
