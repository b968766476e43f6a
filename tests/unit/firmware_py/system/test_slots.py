"""Slots: format, order of writing, clearing, and slots that cannot be read or belong to an earlier version."""

import os
import zlib

import pytest

from firmware_py.common.records import Stored
from firmware_py.system.slots import SlotWriter, earlier_name, examine, find_earlier_slots
from firmware_py.system.state_export import Export, begin_import


@pytest.fixture
def writer(tmp_path):
    opened = SlotWriter(tmp_path, frozenset({"a.key"}))
    yield opened
    opened.close()


def sequence_of(path):
    return int(path.read_bytes().split()[3])


def test_versions_are_written_alternately_with_sequence_length_and_checksum(writer, tmp_path, monkeypatch):
    synced, fsync = [], os.fsync
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(fsync(descriptor)))
    for number, content in enumerate((b"one", b"three", b"", b"x" * 5000), start=1):
        writer.write("a", content)
        checksum = zlib.crc32(content, zlib.crc32(b"%d" % number))
        expected = b"# rambler state %d %d %08x\n%s" % (number, len(content), checksum, content)
        slot = tmp_path / f"a.{(number - 1) % 2}"
        assert slot.read_bytes().startswith(expected)
        assert slot.stat().st_size == (4096 if number < 4 else 8192)
        assert examine(tmp_path, "a") == Stored(content)
    assert (writer.versions, writer.written_bytes) == (4, 2 * 4096 + 2 * 4096 + 4096 + 2 * 8192)
    assert len(synced) == 2  # the directory, for each new file
    slot.write_bytes(b"# rambler empty\n")
    assert examine(tmp_path, "a") == Stored(b"")


def test_another_run_continues_with_the_older_slot(writer, tmp_path):
    for content in (b"one", b"two", b"three"):
        previous_run = SlotWriter(tmp_path, frozenset())
        previous_run.write("a", content)
        previous_run.close()
    assert [sequence_of(tmp_path / f"a.{slot}") for slot in (0, 1)] == [3, 2]
    (tmp_path / "a.0").write_bytes(b"damaged")
    writer.write("a", b"four")
    assert [sequence_of(tmp_path / f"a.{slot}") for slot in (0, 1)] == [3, 2]
    assert (tmp_path / "a.0.aside").read_bytes() == b"damaged"
    assert examine(tmp_path, "a") == Stored(b"four")


def test_cleared_name_is_empty_and_starts_again(writer, tmp_path):
    writer.clear("a")
    assert list(tmp_path.iterdir()) == []
    writer.write("a", b"one")
    writer.clear("a")
    assert [path.name for path in tmp_path.iterdir()] == ["a.0"]
    writer.write("a", b"two")
    writer.write("a", b"x" * 9000)
    writer.clear("a")
    assert examine(tmp_path, "a") == Stored()
    assert [(tmp_path / f"a.{slot}").read_bytes().rstrip(b"\0") for slot in (0, 1)] == [b"# rambler empty\n"] * 2
    assert (tmp_path / "a.1").stat().st_size == 3 * 4096  # all of the former content is overwritten
    writer.write("a", b"three")
    assert sequence_of(tmp_path / "a.0") == 1


@pytest.mark.parametrize(("unreadable", "written"), [((0,), 0), ((1,), 1), ((0, 1), 0)])
def test_unreadable_slots_are_replaced_by_the_first_version(writer, tmp_path, unreadable, written):
    """Otherwise their content would be used when they are readable again."""
    for slot in unreadable:
        os.mkfifo(tmp_path / f"a.{slot}")
    problems = [f"a.{slot} cannot be read (is a pipe, not a regular file)" for slot in unreadable]
    assert examine(tmp_path, "a") == Stored(damage=", ".join(problems))
    writer.write("a", b"new")
    assert sequence_of(tmp_path / f"a.{written}") == 1
    assert {path.name for path in tmp_path.iterdir()} == {
        name for slot in unreadable for name in (f"a.{slot}", f"a.{slot}.aside")
    }
    assert examine(tmp_path, "a") == Stored(b"new")


def test_record_of_an_earlier_version_hides_the_present_one_until_it_is_set_aside(writer, tmp_path):
    assert [earlier_name(name) for name in ("a.record", "a.param")] == ["a.state", ""]
    previous_run = SlotWriter(tmp_path, frozenset())
    for name in ("a.record", "b.record"):
        previous_run.write(name, b"before the roll-back")
    previous_run.close()
    writer.write("b.record", b"new")
    for name in ("a.state.1", "b.state.0"):
        (tmp_path / name).write_bytes(b"earlier")
    assert [path.name for path in find_earlier_slots(tmp_path, "a.record")] == ["a.state.1"]
    assert examine(tmp_path, "a.record") == Stored(damage="a.state.1 is of another version")
    for name in ("a.record", "b.record", "c.record", "a.param"):
        writer.set_aside(name)
    assert [examine(tmp_path, name) for name in ("a.record", "b.record")] == [Stored(), Stored(b"new")]
    assert [(tmp_path / f"{name}.old").read_bytes() for name in ("a.state.1", "b.state.0")] == [b"earlier"] * 2
    assert find_earlier_slots(tmp_path, "a.record") == []


def test_pending_import_has_priority_over_the_slots_of_its_names(writer, tmp_path):
    for name in ("a.param", "b.param", "c.param"):
        writer.write(name, b"slot")
    begin_import(tmp_path, Export({"a.param": b"imported", "b.param": None}))
    stored = [examine(tmp_path, name) for name in ("a.param", "b.param", "c.param")]
    assert stored == [Stored(b"imported"), Stored(), Stored(b"slot")]
    (tmp_path / "import.awaited").write_bytes(b"damaged")
    assert examine(tmp_path, "a.param") == Stored(b"slot")


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
    with monkeypatch.context() as patches:
        patches.setattr(os, "pwrite", lambda *_arguments: 0)
        with pytest.raises(OSError, match="No space left"):
            writer.write("b", b"one")
    assert not (tmp_path / "b.0").exists()  # the next start would report an empty file as damaged
    writer.close()
