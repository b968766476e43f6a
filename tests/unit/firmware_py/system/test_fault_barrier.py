"""A mistake of the link does not take the loop with it; many end the process."""

import pytest

from firmware_py.system.fault_barrier import MOST, WITHIN_S, FaultBarrier


def faulty():
    raise KeyError("inside")


def test_a_mistake_is_told_once_and_explained_and_the_next_call_is_made():
    lines, calls = [], []
    shelter = FaultBarrier(lines.append)
    shelter.call(1.0, faulty)
    shelter.call(2.0, lambda: calls.append(1))
    assert calls == [1]
    assert [event.text for event in shelter.take_events()] == ["Link: KeyError inside, she steers on"]
    assert shelter.take_events() == ()
    assert lines[0].startswith("Traceback")
    assert lines[-1] == "KeyError: 'inside'"


def test_too_many_mistakes_end_the_process():
    shelter = FaultBarrier(lambda _line: None)
    for number in range(MOST):
        shelter.call(float(number), faulty)
    with pytest.raises(KeyError):
        shelter.call(10.0, faulty)


def test_rare_mistakes_do_not_add_up():
    shelter = FaultBarrier(lambda _line: None)
    for number in range(3 * MOST):
        shelter.call(number * WITHIN_S, faulty)
    assert len(shelter.take_events()) == 3 * MOST


def test_an_operators_interrupt_is_no_mistake():
    shelter = FaultBarrier(lambda _line: None)
    with pytest.raises(KeyboardInterrupt):
        shelter.call(0.0, lambda: (_ for _ in ()).throw(KeyboardInterrupt))
