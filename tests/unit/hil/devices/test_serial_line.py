"""An adapter of this computer as the far end of the autopilot's line; a pty stands in for it."""

import pytest

from hil.devices.pty_line import PtyLine
from hil.devices.serial_line import SerialLine, SerialLineError


@pytest.fixture
def far(tmp_path):
    end = PtyLine(tmp_path / "far")
    yield end
    end.close()


@pytest.fixture
def adapter(far, tmp_path):
    line = SerialLine(str(tmp_path / "far"), 57600)
    yield line
    line.close()


def test_bytes_in_both_directions(adapter, far):
    assert adapter.write(b"\xff\x00reply") == 7
    assert far.read_until_total(7) == b"\xff\x00reply"
    assert far.deliver(b"ask")
    assert adapter.read() == b"ask"
    assert adapter.read() == b""
    assert (adapter.total_written, adapter.total_read, adapter.overrun_bytes) == (7, 3, 0)


def test_overrun(adapter):
    sent = adapter.write(bytes(200_000))
    assert 0 < sent < 200_000
    assert adapter.overrun_bytes == 200_000 - sent


def test_unplugged_adapter(adapter, far):
    far.unplug()
    assert adapter.read() == b""
    assert not adapter.plugged
    assert adapter.fileno() == -1
    assert adapter.write(b"x") == 0


def test_adapter_that_cannot_be_opened(tmp_path):
    with pytest.raises(SerialLineError, match="nothing"):
        SerialLine(str(tmp_path / "nothing"), 57600)
