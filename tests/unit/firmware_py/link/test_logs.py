"""Log download: the list, the data, gaps, and erasure."""

import os
import struct
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.mode_table import Mode
from firmware_py.log.archive import archive_log

OPEN_END = 0xFFFFFFFF
SIZES = {1: 900, 2: 50_000, 5: 777}  # the first is a whole number of blocks


def content_of(number):
    return bytes((number + index * 7) % 251 for index in range(SIZES[number]))


@pytest.fixture
def disk(tmp_path):
    (tmp_path / "logs").mkdir()
    for number in SIZES:
        path = tmp_path / "logs" / f"{number:08d}.BIN"
        path.write_bytes(content_of(number))
        os.utime(path, (1_700_000_000 + number, 1_700_000_000 + number))
    return tmp_path / "logs"


@pytest.fixture
def boat(disk, stored):
    return stored()[0]


def entries(rig, of, start=0, end=0xFFFF):
    replies = rig.send(mavlink.MAVLink_log_request_list_message(1, 1, start, end))
    return {one.id: one for one in of(replies, "LOG_ENTRY")}


def ask_data(rig, number, start=0, count=OPEN_END, address="station"):
    return rig.send(mavlink.MAVLink_log_request_data_message(1, 1, number, start, count), address=address)


def blocks(replies):
    return {one.ofs: bytes(one.data[: one.count]) for one in replies if one.get_type() == "LOG_DATA"}


def joined(found):
    content = b""
    for start in sorted(found):
        assert start == len(content)
        content += found[start]
    return content


def download(rig, number, ticks=40):
    """Request a complete log at once, as MAVProxy does."""
    replies = ask_data(rig, number)
    for _ in range(ticks):
        rig.tick_silently()
        replies += rig.give(b"")
    return replies


def test_list_starts_with_the_newest_log_and_continues_with_the_oldest(boat, of):
    found = entries(boat, of)
    assert list(found) == [0, 1, 2]  # as MAVSDK expects
    assert {one.num_logs for one in found.values()} == {3}
    assert [(found[number].size, found[number].time_utc) for number in (1, 2, 0)] == [
        (SIZES[number], 1_700_000_000 + number) for number in (1, 2, 5)
    ]


def test_size_and_time_are_limited_to_32_bits(boat, disk, of):
    os.utime(disk / "00000001.BIN", (-5, -5))
    os.utime(disk / "00000002.BIN", (2**32 + 7, 2**32 + 7))
    os.truncate(disk / "00000005.BIN", 2**32 + 5)
    found = entries(boat, of)
    assert [found[1].time_utc, found[2].time_utc, found[0].size] == [0, 7, 2**32 - 1]


def test_list_of_qgroundcontrol_starts_with_one(boat, of):
    entries(boat, of)
    found = entries(boat, of, 3, 3)  # it requests the entry that it has not received
    assert [(one.id, one.size, one.num_logs, one.last_log_num) for one in found.values()] == [(3, SIZES[5], 3, 3)]
    assert joined(blocks(ask_data(boat, 3, 0, SIZES[5]))) == content_of(5)


@pytest.mark.parametrize(
    ("start", "end", "numbers"),
    [(1, 2, [1, 2]), (2, 0xFFFF, [2, 3]), (4, 9, []), (2, 1, []), (0, 3, [0, 1, 2, 3]), (0, 4, [0, 1, 2]), (0, 0, [0])],
)
def test_part_of_the_list_is_sent(boat, of, start, end, numbers):
    assert list(entries(boat, of, start, end)) == numbers


def test_empty_list_is_one_entry(stored, of):
    rig, _ = stored()
    (only,) = entries(rig, of).values()
    assert (only.num_logs, only.id, only.size) == (0, 0, 0)


@pytest.mark.parametrize(("number", "log"), [(0, 5), (1, 1), (2, 2)])
def test_complete_log_is_sent_for_one_request(boat, of, number, log):
    entries(boat, of)
    replies = download(boat, number)
    assert joined(blocks(replies)) == content_of(log)
    # No empty block at its end: MAVProxy would stop there, whatever was lost before.
    assert all(one.count for one in of(replies, "LOG_DATA"))


def test_chunks_of_a_log_are_sent_at_once(boat, of):
    entries(boat, of)
    found = {}
    for start in range(0, SIZES[2], 46080):
        found.update(blocks(ask_data(boat, 2, start, min(46080, SIZES[2] - start))))
    assert joined(found) == content_of(2)


def test_request_of_a_whole_log_is_limited_per_tick(boat, of):
    entries(boat, of)
    for count, remaining in ((512 * 90, 256), (512 * 90 + 1, 256 - 44)):
        assert len(blocks(ask_data(boat, 2, 0, count))) == -(-count // 90)
        assert len(blocks(ask_data(boat, 2))) == remaining
        assert blocks(boat.give(b"")) == {}
        boat.send(mavlink.MAVLink_log_request_end_message(1, 1))
        boat.tick_silently()


def test_requested_gaps_are_sent_again(boat, of):
    entries(boat, of)
    wanted = [(90 * number, 90 * (1 + number % 3)) for number in range(0, 100, 5)]
    requests = [mavlink.MAVLink_log_request_data_message(1, 1, 2, start, count) for start, count in wanted]
    found = blocks(boat.send(*requests))
    for start, count in wanted:
        sent = b"".join(found[offset] for offset in range(start, start + count, 90))
        assert sent == content_of(2)[start : start + count]


def test_request_beyond_the_end_gets_an_empty_block(boat, of):
    entries(boat, of)
    (replies,) = ask_data(boat, 1, 5000, 90)
    assert (replies.ofs, replies.count) == (5000, 0)


def test_missing_log_is_reported(boat, of, texts):
    entries(boat, of)
    assert texts(ask_data(boat, 4)) == ["Log 4 does not exist"]


def test_data_is_sent_without_a_list_request(boat):
    assert joined(blocks(ask_data(boat, 0))) == content_of(5)


def test_log_numbers_remain_valid_after_a_new_log(boat, disk, of):
    entries(boat, of)
    (disk / "00000006.BIN").write_bytes(b"new")
    with (disk / "00000005.BIN").open("ab") as log:
        log.write(b"more")
    assert joined(blocks(ask_data(boat, 0))) == content_of(5)  # as large as it was listed


def test_log_that_has_become_shorter_ends_with_an_empty_block(boat, disk, of):
    entries(boat, of)
    os.truncate(disk / "00000002.BIN", 90)
    replies = of(ask_data(boat, 2, 0, 1000), "LOG_DATA")
    assert [(one.ofs, one.count) for one in replies] == [(0, 90), (90, 0)]


def test_long_list_is_sent_before_the_next_tick(stored, disk, of):
    for number in range(10, 110):
        (disk / f"{number:08d}.BIN").write_bytes(b"log")
    rig, _ = stored()
    found = entries(rig, of)
    assert list(found) == list(range(103))
    assert {(one.num_logs, one.last_log_num) for one in found.values()} == {(103, 102)}


def test_sixty_four_gaps_are_queued(boat, of):
    entries(boat, of)
    boat.transport.is_writable = False
    for number in range(100):
        for start in (0, 0, 45):  # the second is equal to the first, and the third is a part of it
            request = mavlink.MAVLink_log_request_data_message(1, 1, 2, 180 * number + start, 90 - start)
            boat.transport.inbox.append(("station", boat.frame(request)))
    for _ in range(100):
        boat.endpoint.service(boat.now_s, [boat.transport.descriptor])
    boat.transport.is_writable = True
    sent = [(one.ofs, one.count) for one in of(boat.give(b""), "LOG_DATA")]
    # The first is sent before the others are queued, and one that is being sent may be queued again.
    assert sorted(set(sent)) == [(180 * number, 90) for number in range(1 + 64)]
    assert len(sent) <= 1 + 64 + 1


@pytest.mark.parametrize("kind", ["list", "data"])
def test_line_is_used_for_70_percent_by_lists_and_logs(stored, disk, of, kind):
    for number in range(10, 110):
        (disk / f"{number:08d}.BIN").write_bytes(b"log")
    rig, _ = stored(byte_rate=5760.0, has_radio_rates=True)
    if kind == "list":
        sent = len(entries(rig, of))
        sent += sum(len(of(rig.tick(), "LOG_ENTRY")) for _ in range(20))
    else:
        sent = len(blocks(ask_data(rig, 2)))
        sent += sum(len(blocks(rig.tick())) for _ in range(20))
    assert sent == pytest.approx(0.7 * 5760.0 * 2.1 / 109.0, abs=2)


def test_removed_log_ends_the_download(boat, disk, of):
    entries(boat, of)
    (disk / "00000002.BIN").unlink()
    assert blocks(ask_data(boat, 2)) == {}
    assert not boat.endpoint.busy
    assert joined(blocks(ask_data(boat, 0))) == content_of(5)


def test_log_request_end_ends_the_stream(boat, of):
    entries(boat, of)
    ask_data(boat, 2)
    boat.send(mavlink.MAVLink_log_request_end_message(1, 1))
    boat.tick_silently()
    assert blocks(boat.give(b"")) == {}


def test_four_stations_download_and_the_fifth_is_refused(disk, stored, of, texts):
    rig, _ = stored(addresses=("one", "two", "three", "four", "five"))
    for address in ("one", "two", "three", "four"):
        rig.transport.inbox.append((address, rig.frame(mavlink.MAVLink_log_request_data_message(1, 1, 2, 0, OPEN_END))))
    rig.give(b"")
    replies = ask_data(rig, 0, address="five")
    assert texts(replies) == ["Log download refused: server busy, try again"]
    sent = {address: {} for address in ("one", "two")}
    for _ in range(40):
        rig.tick_silently()
        rig.endpoint.service(rig.now_s, [])
        rig.finish()
        everything, rig.transport.sent = rig.transport.sent, []
        for address, found in sent.items():
            rig.transport.sent = list(everything)
            found.update(blocks(rig.replies(address)))
    # The first blocks were sent before the loop, and are not in `sent`.
    for found in sent.values():
        assert min(found) <= 512 * 90
        assert b"".join(found[start] for start in sorted(found)) == content_of(2)[min(found) :]


def test_station_with_a_complete_list_blocks_no_other(disk, stored, of):
    names = ("one", "two", "three", "four", "five")
    rig, _ = stored(addresses=names)
    for address in names[:4]:
        rig.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF), address=address)
    assert joined(blocks(ask_data(rig, 0, address="five"))) == content_of(5)


def test_downloads_of_silent_stations_are_replaced(disk, stored, texts):
    names = ("one", "two", "three", "four", "five")
    rig, _ = stored(addresses=names)
    for address in names[:4]:
        rig.transport.inbox.append((address, rig.frame(mavlink.MAVLink_log_request_data_message(1, 1, 2, 0, OPEN_END))))
    rig.give(b"")
    rig.transport.is_writable = False  # so that none of them has all
    rig.tick_silently(seconds=9.0)
    ask_data(rig, 0, address="five")
    rig.tick_silently(seconds=2.0)
    ask_data(rig, 0, address="five")
    rig.transport.is_writable = True
    rig.endpoint.service(rig.now_s, [])
    replies = rig.replies("five")
    assert texts(replies) == ["Log download refused: server busy, try again"]
    assert blocks(replies)


def test_slow_line_is_not_overloaded(disk, stored, of):
    rig, _ = stored(byte_rate=5760.0, has_radio_rates=True)
    replies = ask_data(rig, 0)
    beats = 0
    for _ in range(20):
        more = rig.tick()
        beats += len(of(more, "HEARTBEAT"))
        replies += more
    assert joined(blocks(replies)) == content_of(5)
    assert beats == pytest.approx(2, abs=1)


def test_log_frames_equal_those_of_pymavlink(boat):
    boat.transport.sent.clear()
    boat.transport.inbox.append(("station", boat.frame(mavlink.MAVLink_log_request_data_message(1, 1, 1, 0, 90))))
    boat.endpoint.service(boat.now_s, [100])
    ((_, data),) = boat.transport.sent
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    sender.seq = data[4]
    # Log number 1 is the oldest log; the block is complete.
    expected = mavlink.MAVLink_log_data_message(1, 0, 90, list(content_of(1)[:90]))
    assert data == expected.pack(sender)
    assert struct.unpack_from("<IHB", data, 10) == (0, 1, 90)


# ---------------------------------------------------------------------- erasure

ERASE = mavlink.MAVLink_log_erase_message(1, 1)


def test_all_logs_except_the_present_one_are_erased(boat, disk, texts):
    boat.tick_silently(armed=False, mode=Mode.HOLD)
    boat.replies()
    assert "2 logs erased" in texts(boat.send(ERASE))
    assert [path.name for path in disk.iterdir()] == ["00000005.BIN"]


def test_logs_are_not_erased_while_armed(boat, disk, texts):
    assert texts(boat.send(ERASE)) == ["Log erase refused: armed, disarm first"]
    assert len(list(disk.iterdir())) == 3


def test_logs_that_cannot_be_erased_are_reported(boat, disk, texts, monkeypatch):
    def fail(path, *, missing_ok):
        raise OSError("the disk is locked " + "x" * 300)

    boat.tick_silently(armed=False)
    boat.replies()
    monkeypatch.setattr(Path, "unlink", fail)
    (text,) = texts(boat.send(ERASE))
    assert text == ("Logs could not be erased: the disk is locked " + "x" * 300)[:200]


def test_erasure_ends_a_download(boat, of):
    entries(boat, of)
    ask_data(boat, 2)
    boat.tick_silently(armed=False)
    boat.replies()
    boat.send(ERASE)
    boat.tick_silently(armed=False)
    assert blocks(boat.give(b"")) == {}


# ---------------------------------------------------------------------- compressed


def compressed(disk, number):
    """Compress a log step by step; a station may send a request after each step."""
    path = disk / f"{number:08d}.BIN"
    job = archive_log(path)
    for _ in job:
        yield
    assert not path.exists()


def test_compressed_log_is_listed_and_sent_uncompressed(boat, disk, of):
    before = {number: (one.size, one.time_utc) for number, one in entries(boat, of).items()}
    for number in (1, 2):
        list(compressed(disk, number))
    assert {number: (one.size, one.time_utc) for number, one in entries(boat, of).items()} == before
    assert joined(blocks(download(boat, 2))) == content_of(2)
    assert joined(blocks(download(boat, 1))) == content_of(1)


def test_download_continues_while_the_log_is_compressed(boat, disk, of):
    before = entries(boat, of)
    found = blocks(ask_data(boat, 2, 0, 900))
    for _ in compressed(disk, 2):
        assert {number: one.size for number, one in entries(boat, of).items()} == {
            number: one.size for number, one in before.items()
        }
        found.update(blocks(ask_data(boat, 2, 0, 900)))
    found.update(blocks(download(boat, 2)))
    assert joined(found) == content_of(2)


def test_log_compressed_after_the_listing_is_sent(boat, disk, of):
    entries(boat, of)
    list(compressed(disk, 2))
    assert joined(blocks(download(boat, 2))) == content_of(2)


def test_damaged_compressed_log_ends_the_download_and_truncated_one_is_not_listed(boat, disk, of):
    list(compressed(disk, 2))
    path = disk / "00000002.BIN.gz"
    data = bytearray(path.read_bytes())
    data[200] ^= 1
    path.write_bytes(data)
    assert list(entries(boat, of)) == [0, 1, 2]
    assert blocks(ask_data(boat, 2)) == {}
    assert not boat.endpoint.busy
    path.write_bytes(data[:300])
    assert list(entries(boat, of)) == [0, 1]


def test_both_names_of_a_log_are_erased(boat, disk, texts):
    copy = (disk / "00000002.BIN").read_bytes()
    list(compressed(disk, 1))
    list(compressed(disk, 2))
    (disk / "00000002.BIN").write_bytes(copy)  # as between the last two steps
    boat.tick_silently(armed=False, mode=Mode.HOLD)
    boat.replies()
    assert "2 logs erased" in texts(boat.send(ERASE))
    assert [path.name for path in disk.iterdir()] == ["00000005.BIN"]


# ---------------------------------------------------------------------- removed while they are read


@pytest.mark.parametrize("removed", [SIZES, [1, 2]], ids=["all", "all but one"])
def test_repeated_list_request_does_not_disturb_a_download(boat, disk, of, removed):
    entries(boat, of)
    found = blocks(ask_data(boat, 2))  # the file is open now: after its removal it can be read to the end
    for number in removed:
        (disk / f"{number:08d}.BIN").unlink()
    found.update(blocks(boat.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))))
    for _ in range(10):
        boat.tick_silently()
        found.update(blocks(boat.give(b"")))
    assert joined(found) == content_of(2)
    assert not boat.endpoint.busy


def test_number_that_now_names_another_log_does_not_mix_two_logs(boat, disk, of):
    entries(boat, of)
    ask_data(boat, 2)
    (disk / "00000001.BIN").unlink()
    entries(boat, of)
    later = content_of(5)
    found = blocks(ask_data(boat, 2, 0, 90)) | blocks(ask_data(boat, 2, 90, SIZES[5]))
    for _ in range(10):
        boat.tick_silently()
        found.update(blocks(boat.give(b"")))
    assert joined(found) == later
