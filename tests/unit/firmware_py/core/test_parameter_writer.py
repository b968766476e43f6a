"""Rate limit of parameter writes, and the number of callbacks that wait for one."""

from firmware_py.core.parameter_writer import ParameterWriter


class Store:
    """Counts the writes; the callbacks wait."""

    def __init__(self):
        self.writes, self.waiting, self.is_cleared = [], [], False

    def save_parameters(self, changed):
        self.writes.append(changed)

    def clear_parameters(self):
        self.is_cleared = True

    def when_parameters_stored(self, call):
        self.waiting.append(call)


def test_a_stream_of_changes_is_written_a_thousand_times_and_then_every_two_seconds():
    store = Store()
    writer = ParameterWriter(store)
    for number in range(1100):
        writer.change("STEER_P", float(number))
        writer.update(0.0)
    assert len(store.writes) == 1000
    writer.update(1.9)
    assert len(store.writes) == 1000
    writer.update(2.0)
    assert store.writes[1000:] == [{"STEER_P": 1099.0}]
    writer.change("STEER_P", 5.0)
    writer.update(3.0)
    assert len(store.writes) == 1001
    writer.update(3.0, last=True)
    assert store.writes[1001:] == [{"STEER_P": 5.0}]


def test_256_callbacks_wait_for_a_write_and_a_further_one_is_called_with_false():
    store = Store()
    writer = ParameterWriter(store)
    for number in range(1000):
        writer.change("STEER_P", float(number))
        writer.update(0.0)
    writer.change("STEER_P", 1.0)
    answers = []
    for _ in range(257):
        writer.when_stored(answers.append, 0.5)
    assert (answers, store.waiting) == ([False], [])
    writer.forget()
    assert (len(store.waiting), store.is_cleared, store.writes[-1]) == (256, True, {"STEER_P": 1.0})
