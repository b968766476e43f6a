"""A mistake of the link does not take the loop with it; many end the process."""

import pytest

from firmware_py.system.fault_barrier import ERROR_WINDOW_S, MAX_ERRORS, FaultBarrier


def faulty():
    raise KeyError("inside")


def test_an_error_is_reported_once_with_a_traceback_and_the_next_call_is_made():
    lines, calls = [], []
    barrier = FaultBarrier(lines.append)
    barrier.call(1.0, faulty)
    barrier.call(2.0, lambda: calls.append(1))
    assert calls == [1]
    assert [event.text for event in barrier.take_events()] == ["Link error KeyError; autopilot unaffected"]
    assert barrier.take_events() == ()
    assert lines[0].startswith("Traceback")
    assert lines[-1] == "KeyError: 'inside'"


def test_too_many_errors_end_the_process():
    barrier = FaultBarrier(lambda _line: None)
    for number in range(MAX_ERRORS):
        barrier.call(float(number), faulty)
    with pytest.raises(KeyError):
        barrier.call(10.0, faulty)


def test_rare_errors_do_not_accumulate():
    barrier = FaultBarrier(lambda _line: None)
    for number in range(3 * MAX_ERRORS):
        barrier.call(number * ERROR_WINDOW_S, faulty)
    assert len(barrier.take_events()) == 3 * MAX_ERRORS


def test_an_interrupt_is_not_an_error():
    barrier = FaultBarrier(lambda _line: None)
    with pytest.raises(KeyboardInterrupt):
        barrier.call(0.0, lambda: (_ for _ in ()).throw(KeyboardInterrupt))
