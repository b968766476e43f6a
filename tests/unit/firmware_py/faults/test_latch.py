from firmware_py.common.records import Severity
from firmware_py.faults.latch import LatchState, update
from firmware_py.faults.page import markdown
from firmware_py.faults.table import TABLE, Fault


def run(conditions_at):
    """Yield (time, set faults, events) while the conditions of Fault.RUDDER_ERROR follow a script."""
    state = LatchState()
    for t_s, stands in conditions_at:
        state, events = update(state, [fault is Fault.RUDDER_ERROR and stands for fault in TABLE], t_s)
        yield t_s, state.is_set(Fault.RUDDER_ERROR), events


def test_a_fault_is_set_after_its_debounce_and_told_once():
    seen = list(run([(0.0, False), (1.0, True), (1.2, True), (1.31, True), (1.4, True), (2.0, False), (3.0, False)]))
    assert [is_set for _, is_set, _ in seen] == [False, False, False, True, True, True, False]
    told = [(t_s, event.severity, event.text) for t_s, _, events in seen for event in events]
    row = TABLE[Fault.RUDDER_ERROR]
    assert told == [(1.31, row.severity, row.text), (3.0, Severity.NOTICE, row.recovery)]


def test_a_short_condition_is_not_a_fault():
    seen = list(run([(0.0, True), (0.2, False), (0.4, True), (0.6, False)]))
    assert not any(is_set or events for _, is_set, events in seen)


def test_the_table_is_in_the_order_of_its_bits_and_its_texts_fit_a_status_text():
    assert list(TABLE) == list(Fault) == list(range(len(Fault)))
    for row in TABLE.values():
        assert len(row.text) <= 50
        assert len(row.recovery) <= 50
        assert row.condition in markdown()


def test_a_condition_that_began_at_time_zero_and_went_is_forgotten():
    seen = list(run([(0.0, True), (0.1, False), (5.0, True), (5.1, True)]))
    assert not any(is_set for _, is_set, _ in seen)
