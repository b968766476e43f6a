"""An error of the link does not end the loop; many errors end the process."""

import pytest

from firmware_py.system.fault_barrier import FaultBarrier

ERROR_WINDOW_S = 600.0
MAX_ERRORS = 5


def fail():
    raise KeyError("inside")


@pytest.fixture
def barrier():
    return FaultBarrier(lambda _line: None)


def test_an_error_is_reported_with_a_traceback_and_the_next_call_is_made():
    lines, calls = [], []
    barrier = FaultBarrier(lines.append)
    barrier.call(1.0, fail)
    barrier.call(2.0, lambda: calls.append(1))
    assert calls == [1]
    assert [event.text for event in barrier.take_events()] == ["Link error KeyError; autopilot unaffected"]
    assert barrier.take_events() == ()
    assert (lines[0].split()[0], lines[-1]) == ("Traceback", "KeyError: 'inside'")


def test_rare_errors_are_not_raised(barrier):
    for number in range(3 * MAX_ERRORS):
        barrier.call(number * ERROR_WINDOW_S, fail)
    assert len(barrier.take_events()) == 3 * MAX_ERRORS


def test_an_interrupt_is_raised(barrier):
    with pytest.raises(KeyboardInterrupt):
        barrier.call(0.0, lambda: (_ for _ in ()).throw(KeyboardInterrupt))


@pytest.mark.parametrize(("t_s", "is_raised"), [(599.9, True), (600.0, False)])
def test_sixth_error_is_raised_within_ten_minutes_of_the_first(barrier, t_s, is_raised):
    for second in range(5):
        barrier.call(float(second), fail)
    if is_raised:
        with pytest.raises(KeyError):
            barrier.call(t_s, fail)
    else:
        barrier.call(t_s, fail)
    assert len(barrier.take_events()) == (5 if is_raised else 6)
