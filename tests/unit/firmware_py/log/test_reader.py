import pytest

from firmware_py.log import schema
from firmware_py.log.dataflash import LogError, MessageType, Parser, header
from firmware_py.log.reader import LogReader, read_log


def read(data):
    reader = LogReader(data)
    return list(reader), reader.reading


def tick_boundaries(data):
    """Return the offsets of the ends of the ticks, and of the start of the first."""
    records = [(record.name, offset, offset + record.length) for record, offset in Parser(data)]
    ends = [end for name, _, end in records if name == "END"]
    return ends, next(offset for name, offset, _ in records if name == "TICK")


def log_of_tick(body, *types):
    return header((*schema.TYPES, *types), 1000) + schema.append_end(body, 1.0, 0)


def test_a_whole_log(tmp_path, fake):
    ticks, reading = read(fake.write_log(tmp_path))
    assert [tick.inputs for tick in ticks] == [fake.make_inputs(index) for index in range(6)]
    assert (reading.software, reading.ticks, reading.damaged) == ("Rambler test", 6, 0)
    assert reading.garbage_bytes == reading.tail_bytes == 0
    assert list(read_log(tmp_path / "00000001.BIN")) == ticks


def test_a_truncated_log_is_read_to_its_last_whole_tick(tmp_path, fake):
    data = fake.write_log(tmp_path, 3)
    ends, first = tick_boundaries(data)
    all_ticks, _ = read(data)
    for size in {
        *range(0, first, 101),
        *range(first, len(data), 23),
        *(end + by for end in ends for by in (-2, -1, 0)),
    }:
        ticks, reading = read(data[:size])
        complete = sum(end <= size for end in ends)
        assert ticks == all_ticks[:complete]
        assert reading.damaged == reading.garbage_bytes == 0
        if size > first:
            assert reading.tail_bytes == size - ([first, *ends][complete])


@pytest.mark.parametrize("junk", [b"\0" * 4096, bytes(range(256)) * 3, b"\xa3\x95", b"\xa3\x95\x8e"])
def test_garbage_between_ticks_loses_no_tick(tmp_path, fake, junk):
    data = fake.write_log(tmp_path, 4)
    ends, _ = tick_boundaries(data)
    ticks, reading = read(data[: ends[1]] + b"\0" + junk + data[ends[1] :])
    assert ticks == read(data)[0]
    assert (reading.damaged, reading.garbage_bytes) == (0, len(junk) + 1)


def test_garbage_inside_a_tick_loses_at_most_that_tick(tmp_path, fake):
    data = fake.write_log(tmp_path, 4)
    ends, _ = tick_boundaries(data)
    all_inputs = [tick.inputs for tick in read(data)[0]]
    for offset in range(ends[0] + 1, ends[1], 7):
        ticks, reading = read(data[:offset] + b"\0\xa3\x95junk" + data[offset:])
        assert [tick.inputs for tick in ticks if tick.inputs != all_inputs[1]] == [all_inputs[0], *all_inputs[2:]]
        assert reading.damaged == 4 - len(ticks)


def test_a_flipped_bit_damages_its_tick_and_makes_a_gap(tmp_path, fake):
    data = bytearray(fake.write_log(tmp_path, 4))
    ends, _ = tick_boundaries(bytes(data))
    all_inputs = [tick.inputs for tick in read(bytes(data))[0]]
    for offset in range(ends[0], ends[1], 13):
        data[offset] ^= 0x10
        ticks, reading = read(bytes(data))
        data[offset] ^= 0x10
        assert [tick.inputs for tick in ticks] == [all_inputs[0], *all_inputs[2:]]
        assert [tick.gap for tick in ticks] == [False, True, False]
        assert reading.damaged == 1


def test_missing_ticks_are_a_gap_and_no_damage(tmp_path, fake):
    data = fake.write_log(tmp_path, 4)
    ends, _ = tick_boundaries(data)
    ticks, reading = read(data[: ends[0]] + data[ends[2] :])
    assert [(tick.inputs.tick.index, tick.gap) for tick in ticks] == [(0, False), (3, True)]
    assert reading.damaged == 0


def test_an_end_without_its_tick_is_damage(tmp_path, fake):
    data = fake.write_log(tmp_path, 2)
    ticks, reading = read(data + data[-schema.END.size :])
    assert (len(ticks), reading.damaged) == (2, 1)


def test_a_tick_without_a_command_is_damage(fake):
    inputs = fake.make_inputs(5)
    ticks, reading = read(log_of_tick(schema.TICK.pack(1.0, inputs.tick) + schema.encode_inputs(inputs)))
    assert (ticks, reading.damaged) == ([], 1)


NEW_TYPE = MessageType(99, "NEW", "TimeUS,X", "QQ", "s-", "F-")
NEW_REQUEST = '{"version":2,"t_s":1.0,"intent":{"type":"Fly","height_m":3.0},"system":1,"component":1}'


@pytest.mark.parametrize(
    ("added", "note"),
    [
        (lambda _request: NEW_TYPE.pack(1, 2) + NEW_TYPE.pack(1, 3), "message NEW: not known here, 2 passed over"),
        (
            lambda request: schema.REQUEST.pack_text(1.0, request, NEW_REQUEST),
            "Request.intent: Invalid value 'Fly', ignored; the record is left out",
        ),
    ],
    ids=["message", "request"],
)
def test_unknown_records_are_skipped_and_noted(fake, added, note):
    inputs, output = fake.make_inputs(1), fake.step(fake.State(), fake.make_inputs(1))[1]
    body = schema.TICK.pack(1.0, inputs.tick) + added(inputs.requests[0])
    body += schema.encode_inputs(inputs) + schema.encode_output(output)
    ticks, reading = read(log_of_tick(body, NEW_TYPE))
    assert [tick.inputs for tick in ticks] == [inputs]
    assert len(reading.notes) == 1
    assert note in reading.notes[0]


def test_a_log_without_a_required_column_is_refused():
    tick = MessageType(schema.TICK.type.number, "TICK", "TimeUS,Tick", "QQ", "s-", "F-")
    with pytest.raises(LogError, match=r"TICK has no column T.*version"):
        read(header((tick, schema.END), 1000) + schema.append_end(tick.pack(1, 2), 1.0, 0))
    end = MessageType(schema.END.number, "END", "TimeUS,Crc", "QI", "s-", "F-")
    with pytest.raises(LogError, match=r"END.*version"):
        read(header((tick, end), 1000) + end.pack(1, 2))


@pytest.mark.parametrize("count", [1, 0])
def test_a_tick_has_up_to_131072_records(fake, count):
    inputs, output = fake.make_inputs(5), fake.step(fake.State(), fake.make_inputs(5))[1]
    body = schema.TICK.pack(1.0, inputs.tick) + schema.encode_inputs(inputs) + schema.encode_output(output)
    head = header(schema.TYPES, 0)
    records = sum(1 for _ in Parser(head + body)) - sum(1 for _ in Parser(head))
    ticks, reading = read(log_of_tick(body + NEW_TYPE.pack(1, 2) * (131_072 - records + 1 - count), NEW_TYPE))
    assert (len(ticks), reading.damaged) == (count, 1 - count)


@pytest.mark.parametrize("data", [b"", b"\0" * 1000, b"# Rambler\n" * 100])
def test_other_data_has_no_ticks(data):
    ticks, reading = read(data)
    assert ticks == []
    assert reading.tail_bytes == len(data)


def test_empty_and_missing_files(tmp_path):
    (tmp_path / "empty.BIN").touch()
    assert list(LogReader(tmp_path / "empty.BIN")) == []
    with pytest.raises(LogError, match=r"No such file or directory: give the path of a \.BIN or \.BIN\.gz file"):
        list(LogReader(tmp_path / "none.BIN"))
    with pytest.raises(LogError, match="directory"):
        list(LogReader(tmp_path))


def test_reading_can_be_stopped(tmp_path, fake):
    fake.write_log(tmp_path)
    ticks = read_log(tmp_path / "00000001.BIN")
    assert next(ticks).inputs == fake.make_inputs(0)
    ticks.close()
