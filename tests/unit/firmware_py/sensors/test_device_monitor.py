"""From STARTING to RUNNING to SILENT and back, and the one line of text."""

import pytest

from firmware_py.common.records import DeviceRole, DeviceState
from firmware_py.sensors.device_monitor import LONGEST_TEXT, SILENT_AFTER_S, DeviceMonitor


@pytest.fixture
def condition(line):
    condition = DeviceMonitor(line, DeviceRole.COMPASS)
    assert condition.restarted()
    return condition


def test_the_states_follow_the_messages(line, condition):
    assert condition.health(0.0).state is DeviceState.STARTING
    condition.good(1.0)
    assert condition.health(1.0 + SILENT_AFTER_S).state is DeviceState.RUNNING
    assert condition.health(1.01 + SILENT_AFTER_S).state is DeviceState.SILENT
    condition.good(9.0)
    assert condition.health(9.0, fault="magnet").state is DeviceState.FAULTY
    line.unplug()
    assert condition.health(9.0, fault="magnet").state is DeviceState.ABSENT
    assert line.name in condition.health(9.0).text
    line.plug()
    assert condition.restarted()
    assert not condition.restarted()
    health = condition.health(9.0)
    assert (health.state, health.accepted, health.rejected) == (DeviceState.STARTING, 2, 0)


def test_the_text_is_the_last_error_then_the_note_then_a_hint(condition):
    assert condition.health(0.0).text == ""
    condition.heard(0.0)
    assert "baud rate" in condition.health(0.0).text
    condition.note("no fix")
    assert condition.health(0.0).text == "no fix"
    condition.bad(0.0, "checksum")
    condition.good(0.0)
    assert condition.health(9.0).text == "checksum"
    assert condition.health(11.0).text == "no fix"
    condition.note("")
    assert condition.health(1.0).rejected == 1
    assert condition.health(12.0).text == ""


def test_texts_from_the_outside_are_bounded_and_printable(line, condition):
    line.name = "/dev/\x1b[2J\u2028" + "x" * 500
    condition.bad(0.0, "a\nb\0c\xff" + "x" * 500)
    texts = [condition.health(0.0).text, condition.health(0.0, fault="\n" * 500).text]
    line.unplug()
    texts.append(condition.health(0.0).text)
    for text in texts:
        assert len(text) <= LONGEST_TEXT
        assert text.isascii()
        assert text.isprintable() or not text
