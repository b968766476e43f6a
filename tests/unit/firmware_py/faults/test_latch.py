"""Latch of the faults: debounce and clear times, events, refusal of arming."""

from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.records import Event, Severity
from firmware_py.faults.latch import LatchState, arming_refusal, update
from firmware_py.faults.page import markdown
from firmware_py.faults.table import TABLE, Fault


def run(conditions, fault=Fault.RUDDER_ERROR):
    """Yield time, whether the fault is set, and events for rows of time and condition."""
    state = LatchState()
    for t_s, present in conditions:
        state, events = update(state, [other is fault and present for other in TABLE], t_s)
        yield t_s, state.is_set(fault), events


def test_fault_is_set_after_its_debounce_time_and_reported_once():
    states = list(run([(0.0, False), (1.0, True), (1.2, True), (1.31, True), (1.4, True), (2.0, False), (3.0, False)]))
    assert [is_set for _, is_set, _ in states] == [False, False, False, True, True, True, False]
    events_by_time = [(t_s, event.severity, event.text) for t_s, _, events in states for event in events]
    row = TABLE[Fault.RUDDER_ERROR]
    assert events_by_time == [(1.31, row.severity, row.text), (3.0, Severity.NOTICE, row.recovery)]


def test_intermittent_disk_error_is_one_fault():
    script = [(0.2 * tick, tick % 20 < 12) for tick in range(500)]  # 2.4 s with, then 1.6 s without the error
    events_by_time = [event.text for _, _, events in run(script, Fault.STORAGE_FAILING) for event in events]
    assert events_by_time == [TABLE[Fault.STORAGE_FAILING].text]


@pytest.mark.parametrize("times_s", [(0.0, 0.2, 0.4, 0.6), (0.0, 0.1, 5.0, 5.1)])
def test_interrupted_condition_sets_no_fault(times_s):
    conditions = zip(times_s, (True, False, True, times_s[-1] > 5.0), strict=True)
    assert not any(is_set or events for _, is_set, events in run(conditions))


def test_table_has_the_order_of_the_bits_and_short_texts():
    assert list(TABLE) == list(Fault) == list(range(len(Fault)))
    for row in TABLE.values():
        assert len(row.text) <= 50
        assert len(row.recovery) <= 50
        assert row.condition in markdown()


def expected_states(row, conditions):
    """Yield whether the fault is set after each row of time and condition, by a direct implementation."""
    is_set, start_s, last_s = False, None, None
    for t_s, present in conditions:
        if present:
            start_s, last_s = (t_s if start_s is None else start_s), t_s
            is_set = is_set or t_s - start_s >= row.debounce_s
        elif not is_set or t_s - last_s >= row.clear_s:
            is_set, start_s = False, None
        yield is_set


STEPS = st.lists(st.tuples(st.sampled_from([0.1, 0.3, 1.0, 7.0]), st.frozensets(st.sampled_from(list(Fault)))))


@given(STEPS)
def test_faults_are_set_and_cleared_by_their_own_times_and_reported(steps):
    times_s = list(accumulate(step_s for step_s, _ in steps))
    expected = {
        fault: list(
            expected_states(
                row, [(t_s, fault in present_faults) for t_s, (_, present_faults) in zip(times_s, steps, strict=True)]
            )
        )
        for fault, row in TABLE.items()
    }
    state, previous = LatchState(), dict.fromkeys(TABLE, False)
    for index, (t_s, (_, present_faults)) in enumerate(zip(times_s, steps, strict=True)):
        state, events = update(state, [fault in present_faults for fault in TABLE], t_s)
        current = {fault: expected[fault][index] for fault in TABLE}
        assert {fault: state.is_set(fault) for fault in TABLE} == current
        assert list(events) == [
            Event(row.severity, row.text) if current[fault] else Event(Severity.NOTICE, row.recovery)
            for fault, row in TABLE.items()
            if current[fault] is not previous[fault]
        ]
        previous = current


@pytest.mark.parametrize("fault", Fault)
def test_arming_is_refused_with_the_reason_of_the_first_fault(fault):
    assert arming_refusal(1 << fault) == TABLE[fault].arming_refusal
    later = sum(1 << other for other in Fault if other > fault)
    first = next((TABLE[other].arming_refusal for other in Fault if other >= fault and TABLE[other].arming_refusal), "")
    assert arming_refusal(1 << fault | later) == first
    assert arming_refusal(0) == ""
