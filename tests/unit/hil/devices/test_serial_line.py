"""The line on a serial adapter; a pty replaces the adapter."""

from contextlib import closing

import pytest

from hil.devices.pty_line import PtyLine
from hil.devices.serial_line import SerialLine, SerialLineError


@pytest.fixture
def far(tmp_path):
    with closing(PtyLine(tmp_path / "far")) as line:
        yield line


@pytest.fixture
def adapter(far, tmp_path):
    with closing(SerialLine(str(tmp_path / "far"), 57600)) as line:
        yield line


def test_bytes_are_transferred_in_both_directions(adapter, far):
    assert adapter.write(b"\xff\x00reply") == 7
    assert far.read_until_total(7) == b"\xff\x00reply"
    assert far.deliver(b"ask")
    assert adapter.read() == b"ask"
    assert adapter.read() == b""
    assert (adapter.total_written, adapter.total_read, adapter.overrun_bytes) == (7, 3, 0)


def test_overrun_is_counted(adapter):
    sent = adapter.write(bytes(200_000))
    assert 0 < sent < 200_000
    assert adapter.overrun_bytes == 200_000 - sent


def test_unplugged_adapter_sends_nothing(adapter, far):
    far.unplug()
    assert adapter.read() == b""
    assert not adapter.is_plugged
    assert adapter.fileno() == -1
    assert adapter.write(b"x") == 0


def test_missing_adapter_raises_an_error(tmp_path):
    with pytest.raises(SerialLineError, match="missing"):
        SerialLine(str(tmp_path / "missing"), 57600)
