from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.records import Event, Severity
from firmware_py.faults.latch import LatchState, arming_refusal, update
from firmware_py.faults.page import markdown
from firmware_py.faults.table import TABLE, Fault


def run(conditions_at, fault=Fault.RUDDER_ERROR):
    """Yield (time, whether the fault is set, events) while its condition follows a script."""
    state = LatchState()
    for t_s, present in conditions_at:
        state, events = update(state, [one is fault and present for one in TABLE], t_s)
        yield t_s, state.is_set(fault), events


def test_a_fault_is_set_after_its_debounce_time_and_reported_once():
    seen = list(run([(0.0, False), (1.0, True), (1.2, True), (1.31, True), (1.4, True), (2.0, False), (3.0, False)]))
    assert [is_set for _, is_set, _ in seen] == [False, False, False, True, True, True, False]
    reported = [(t_s, event.severity, event.text) for t_s, _, events in seen for event in events]
    row = TABLE[Fault.RUDDER_ERROR]
    assert reported == [(1.31, row.severity, row.text), (3.0, Severity.NOTICE, row.recovery)]


def test_an_intermittent_disk_error_is_one_fault():
    script = [(0.2 * tick, tick % 20 < 12) for tick in range(500)]  # 2.4 s with, then 1.6 s without the error
    reported = [event.text for _, _, events in run(script, Fault.STORAGE_FAILING) for event in events]
    assert reported == [TABLE[Fault.STORAGE_FAILING].text]


def test_a_short_condition_is_not_a_fault():
    seen = list(run([(0.0, True), (0.2, False), (0.4, True), (0.6, False)]))
    assert not any(is_set or events for _, is_set, events in seen)


def test_the_table_is_in_the_order_of_its_bits_and_its_texts_fit_a_status_text():
    assert list(TABLE) == list(Fault) == list(range(len(Fault)))
    for row in TABLE.values():
        assert len(row.text) <= 50
        assert len(row.recovery) <= 50
        assert row.condition in markdown()


def test_a_condition_that_began_at_time_0_is_forgotten():
    seen = list(run([(0.0, True), (0.1, False), (5.0, True), (5.1, True)]))
    assert not any(is_set for _, is_set, _ in seen)


def judged(row, present_at):
    """Yield whether the fault is set at each (t_s, present)."""
    is_set, begun_s, last_s = False, None, None
    for t_s, present in present_at:
        if present:
            begun_s, last_s = (t_s if begun_s is None else begun_s), t_s
            is_set = is_set or t_s - begun_s >= row.debounce_s
        elif not is_set or t_s - last_s >= row.clear_s:
            is_set, begun_s = False, None
        yield is_set


STEPS = st.lists(st.tuples(st.sampled_from([0.1, 0.3, 1.0, 7.0]), st.frozensets(st.sampled_from(list(Fault)))))


@given(STEPS)
def test_each_fault_is_set_and_cleared_by_its_own_times_and_reported(steps):
    times_s = list(accumulate(step_s for step_s, _ in steps))
    expected = {
        fault: list(
            judged(
                row, [(t_s, fault in present_faults) for t_s, (_, present_faults) in zip(times_s, steps, strict=True)]
            )
        )
        for fault, row in TABLE.items()
    }
    state, before = LatchState(), dict.fromkeys(TABLE, False)
    for number, (t_s, (_, present_faults)) in enumerate(zip(times_s, steps, strict=True)):
        state, events = update(state, [fault in present_faults for fault in TABLE], t_s)
        now = {fault: expected[fault][number] for fault in TABLE}
        assert {fault: state.is_set(fault) for fault in TABLE} == now
        assert list(events) == [
            Event(row.severity, row.text) if now[fault] else Event(Severity.NOTICE, row.recovery)
            for fault, row in TABLE.items()
            if now[fault] is not before[fault]
        ]
        before = now


@pytest.mark.parametrize("fault", Fault)
def test_arming_is_refused_with_the_reason_of_the_first_fault(fault):
    assert arming_refusal(1 << fault) == TABLE[fault].arming_refusal
    later = sum(1 << other for other in Fault if other > fault)
    first = next((TABLE[other].arming_refusal for other in Fault if other >= fault and TABLE[other].arming_refusal), "")
    assert arming_refusal(1 << fault | later) == first


def test_without_a_fault_arming_is_not_refused():
    assert arming_refusal(0) == ""
