import pytest

from firmware_py.log import schema
from firmware_py.log.dataflash import LogError, MessageType, Parser, header
from firmware_py.log.reader import LogReader, read_log


def read(data):
    reader = LogReader(data)
    return list(reader), reader.reading


def ends_of_ticks(data):
    """Where each tick is complete, and where the first begins."""
    places = [(found.name, at, at + found.length) for found, at in Parser(data)]
    return [end for name, _, end in places if name == "END"], next(at for name, at, _ in places if name == "TICK")


def test_a_whole_log(tmp_path, pretend):
    data = pretend.logged(tmp_path)
    from_bytes, reading = read(data)
    assert [tick.inputs for tick in from_bytes] == [pretend.inputs_of(index) for index in range(6)]
    assert (reading.software, reading.ticks, reading.damaged) == ("Rambler test", 6, 0)
    assert reading.garbage_bytes == reading.tail_bytes == 0
    assert list(read_log(tmp_path / "00000001.BIN")) == from_bytes


def test_a_log_cut_anywhere_is_read_to_its_last_whole_tick(tmp_path, pretend):
    data = pretend.logged(tmp_path, 3)
    ends, first = ends_of_ticks(data)
    whole, _ = read(data)
    for cut in {*range(0, first, 101), *range(first, len(data), 23), *(end + by for end in ends for by in (-2, -1, 0))}:
        ticks, reading = read(data[:cut])
        complete = sum(end <= cut for end in ends)
        assert ticks == whole[:complete]
        assert reading.damaged == reading.garbage_bytes == 0
        if cut > first:
            assert reading.tail_bytes == cut - ([first, *ends][complete])


@pytest.mark.parametrize("junk", [b"\0" * 4096, bytes(range(256)) * 3, b"\xa3\x95", b"\xa3\x95\x8e"])
def test_garbage_between_ticks_costs_nothing_but_its_own(tmp_path, pretend, junk):
    data = pretend.logged(tmp_path, 4)
    ends, _ = ends_of_ticks(data)
    ticks, reading = read(data[: ends[1]] + b"\0" + junk + data[ends[1] :])
    assert ticks == read(data)[0]
    assert (reading.damaged, reading.garbage_bytes) == (0, len(junk) + 1)


def test_garbage_inside_a_tick_costs_at_most_that_tick(tmp_path, pretend):
    data = pretend.logged(tmp_path, 4)
    ends, _ = ends_of_ticks(data)
    whole, _ = read(data)
    for at in range(ends[0] + 1, ends[1], 7):
        ticks, reading = read(data[:at] + b"\0\xa3\x95junk" + data[at:])
        assert [tick.inputs for tick in ticks if tick.inputs != whole[1].inputs] == [
            whole[index].inputs for index in (0, 2, 3)
        ]
        assert reading.damaged == 4 - len(ticks)


def test_a_flipped_bit_is_damage_and_then_a_gap(tmp_path, pretend):
    data = bytearray(pretend.logged(tmp_path, 4))
    ends, _ = ends_of_ticks(bytes(data))
    whole, _ = read(bytes(data))
    for at in range(ends[0], ends[1], 13):
        data[at] ^= 0x10
        ticks, reading = read(bytes(data))
        data[at] ^= 0x10
        assert [tick.inputs.tick.index for tick in ticks] == [0, 2, 3]
        assert [tick.gap for tick in ticks] == [False, True, False]
        assert [tick.inputs for tick in ticks] == [whole[index].inputs for index in (0, 2, 3)]
        assert reading.damaged == 1


def test_ticks_that_are_missing_are_a_gap(tmp_path, pretend):
    data = pretend.logged(tmp_path, 4)
    ends, _ = ends_of_ticks(data)
    ticks, reading = read(data[: ends[0]] + data[ends[2] :])
    assert [(tick.inputs.tick.index, tick.gap) for tick in ticks] == [(0, False), (3, True)]
    assert reading.damaged == 0


def test_an_end_without_its_tick_is_damage(tmp_path, pretend):
    data = pretend.logged(tmp_path, 2)
    ends, _ = ends_of_ticks(data)
    ticks, reading = read(data + data[ends[1] - schema.END.size :])
    assert (len(ticks), reading.damaged) == (2, 1)


def test_a_tick_without_its_decision_is_damage(tmp_path, pretend):
    data = pretend.logged(tmp_path, 1)
    _, first = ends_of_ticks(data)
    inputs = pretend.inputs_of(5)
    lonely = schema.end_bytes(schema.TICK.pack(1.0, inputs.tick) + schema.inputs_bytes(inputs), 1.0, 0)
    ticks, reading = read(data[:first] + lonely)
    assert (ticks, reading.damaged) == ([], 1)


def test_a_message_that_is_not_known_is_passed_over_and_counted(pretend):
    newer = MessageType(99, "NEW", "TimeUS,X", "QQ", "s-", "F-")
    inputs, command = pretend.inputs_of(0), pretend.step(pretend.State(), pretend.inputs_of(0))[1]
    tick = schema.TICK.pack(1.0, inputs.tick) + newer.pack(1, 2) + newer.pack(1, 3)
    tick += schema.inputs_bytes(inputs) + schema.output_bytes(command)
    ticks, reading = read(header((*schema.TYPES, newer), 1000) + schema.end_bytes(tick, 1.0, 0))
    assert [one.inputs for one in ticks] == [inputs]
    assert reading.notes == ("message NEW: not known here, 2 passed over",)


def test_a_request_that_is_not_known_is_left_out(pretend):
    inputs, command = pretend.inputs_of(1), pretend.step(pretend.State(), pretend.inputs_of(1))[1]
    text = '{"version":2,"t_s":1.0,"intent":{"type":"Fly","height_m":3.0},"system":1,"component":1}'
    later = schema.REQUEST.pack_text(1.0, inputs.requests[0], text)
    tick = schema.TICK.pack(1.0, inputs.tick) + later + schema.inputs_bytes(inputs) + schema.output_bytes(command)
    ticks, reading = read(header(schema.TYPES, 1000) + schema.end_bytes(tick, 1.0, 0))
    assert ticks[0].inputs == inputs
    assert len(reading.notes) == 1
    assert "Request.intent: Invalid value 'Fly', ignored; the record is left out" in reading.notes[0]


def test_a_log_without_the_frame_says_so():
    older = MessageType(schema.TICK.type.number, "TICK", "TimeUS,Tick", "QQ", "s-", "F-")
    with pytest.raises(LogError, match=r"TICK has no column T.*version"):
        read(header((older, schema.END), 1000) + schema.end_bytes(older.pack(1, 2), 1.0, 0))
    shorter = MessageType(schema.END.number, "END", "TimeUS,Crc", "QI", "s-", "F-")
    with pytest.raises(LogError, match=r"END.*version"):
        read(header((older, shorter), 1000) + shorter.pack(1, 2))


@pytest.mark.parametrize("data", [b"", b"\0" * 1000, b"# Rambler\n" * 100])
def test_what_is_not_a_log_has_no_ticks(data):
    ticks, reading = read(data)
    assert ticks == []
    assert reading.tail_bytes == len(data)


def test_files_that_are_empty_or_not_there(tmp_path):
    (tmp_path / "empty.BIN").touch()
    assert list(LogReader(tmp_path / "empty.BIN")) == []
    with pytest.raises(LogError, match="No such file"):
        list(LogReader(tmp_path / "none.BIN"))
    with pytest.raises(LogError, match="directory"):
        list(LogReader(tmp_path))


def test_reading_can_be_stopped(tmp_path, pretend):
    pretend.logged(tmp_path)
    ticks = read_log(tmp_path / "00000001.BIN")
    assert next(ticks).inputs == pretend.inputs_of(0)
    ticks.close()
