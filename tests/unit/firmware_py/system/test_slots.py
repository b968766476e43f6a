import os

import pytest

from firmware_py.system.slots import SlotWriter


def test_failed_write_closes_the_slots_and_the_next_one_opens_them_again(tmp_path, monkeypatch):
    """The file may have been replaced meanwhile, for example by a repair of the disk."""

    def fail(_descriptor):
        raise OSError(5, "Input/output error")

    writer = SlotWriter(tmp_path, frozenset())
    writer.write("a", b"one")
    descriptors = list(writer._files.values())
    with monkeypatch.context() as patches:
        patches.setattr(os, "fdatasync", fail)
        with pytest.raises(OSError, match="Input/output"):
            writer.write("a", b"two")
    assert writer._files == {}
    for descriptor in descriptors:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(descriptor)
    writer.write("a", b"three")
    assert any(b"three" in path.read_bytes() for path in tmp_path.iterdir())
    writer.close()
