"""States and texts of the device monitor."""

import pytest

from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState
from firmware_py.sensors.device_monitor import DeviceMonitor

ERROR_HOLD_S = 10.0
MAX_TEXT_LENGTH = 60
SILENT_AFTER_S = 2.0


@pytest.fixture
def monitor(line):
    monitor = DeviceMonitor(line, DeviceRole.COMPASS)
    assert monitor.notice_reopening()
    return monitor


def test_state_depends_on_messages_fault_and_port(line, monitor):
    assert monitor.health(0.0).state is DeviceState.STARTING
    monitor.accept(1.0)
    assert monitor.health(1.0 + SILENT_AFTER_S).state is DeviceState.RUNNING
    assert monitor.health(1.01 + SILENT_AFTER_S).state is DeviceState.SILENT
    monitor.accept(9.0)
    assert monitor.health(9.0, fault="magnet").state is DeviceState.FAULTY
    line.unplug()
    health = monitor.health(9.0, fault="magnet")
    assert health.state is DeviceState.ABSENT
    assert line.name in health.text
    monitor.note_bytes(9.0)
    monitor.note("no fix")
    monitor.note_unused("only GPGSV")
    monitor.reject(9.0, "checksum", 3)
    line.plug()
    assert monitor.notice_reopening()
    assert not monitor.notice_reopening()
    assert monitor.health(9.0) == DeviceHealth(9.0, DeviceRole.COMPASS, DeviceState.STARTING, 2, 3)
    monitor.note_bytes(9.0)
    assert "baud rate" in monitor.health(9.0).text


def test_text_is_the_recent_error_else_the_note_else_a_hint(monitor):
    assert monitor.health(0.0).text == ""
    monitor.note_bytes(0.0)
    assert "baud rate" in monitor.health(0.0).text
    assert "baud rate" in monitor.health(SILENT_AFTER_S).text
    assert monitor.health(SILENT_AFTER_S + 0.01).text == ""
    monitor.note("no fix")
    assert monitor.health(0.0).text == "no fix"
    monitor.reject(0.0, "checksum")
    monitor.accept(0.0)
    assert monitor.health(ERROR_HOLD_S).text == "checksum"
    assert monitor.health(ERROR_HOLD_S + 0.01).text == "no fix"
    monitor.note("")
    assert monitor.health(1.0).rejected == 1
    assert monitor.health(12.0).text == ""


def test_external_texts_are_truncated_and_printable(line, monitor):
    line.name = "/dev/\x1b[2J\u2028" + "x" * 500
    monitor.reject(0.0, "a\nb\0c\xff" + "x" * 500)
    texts = [monitor.health(0.0).text, monitor.health(0.0, fault="\n" * 500).text]
    line.unplug()
    texts.append(monitor.health(0.0).text)
    for text in texts:
        assert len(text) <= MAX_TEXT_LENGTH
        assert text.isascii()
        assert text.isprintable()


def test_timeout_is_two_and_a_half_intervals_of_the_messages(monitor):
    for second in range(100, 111):
        monitor.accept(float(second))
    assert monitor.health(112.5).state is DeviceState.RUNNING
    assert monitor.health(112.6).state is DeviceState.SILENT


def test_unused_messages_are_named_until_a_message_is_accepted(monitor):
    monitor.note_unused("only GPGSV")
    monitor.note_bytes(1.0)
    assert monitor.health(1.0).text == "only GPGSV"
    monitor.accept(1.0)
    monitor.note_bytes(20.0)
    assert "baud rate" in monitor.health(20.0).text


def test_only_printable_ascii_characters_are_kept(monitor):
    monitor.reject(0.0, "\x1f ~\x7f")
    assert monitor.health(0.0).text == "? ~?"


def test_device_with_bursts_every_five_seconds_is_not_silent_between_them(monitor):
    for burst in range(20):
        for message in range(3):
            now_s = 5.0 * burst + 0.1 * message
            assert monitor.health(now_s - 0.01).state is not DeviceState.SILENT or burst == 1
            monitor.accept(now_s)
    assert monitor.health(110.0).state is DeviceState.SILENT
