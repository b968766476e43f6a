"""Burst reads of file transfer on a slow or blocked line."""

import os

import pytest

END = 6  # error END_OF_FILE
OPEN, READ, BURST = 4, 5, 15  # opcodes
FRAME_BYTES = 266  # of a reply
LOG = "logs/00000001.BIN"
CONTENT = bytes(range(256)) * 5


@pytest.fixture
def disk(tmp_path):
    (tmp_path / "logs").mkdir()
    (tmp_path / LOG).write_bytes(CONTENT)
    return tmp_path


@pytest.fixture
def client(disk, stored):
    return stored()[1]


def test_burst_does_not_stop_telemetry_on_a_slow_link(disk, stored, of):
    rig, client = stored(byte_rate=5760.0, has_radio_rates=True)
    client.ask(OPEN, LOG)
    assert client.ask(BURST, offset=len(CONTENT), size=239).error == (END,)  # before there is capacity for parts
    client.all(BURST, size=239)
    parts, heartbeats, attitudes = [], 0, 0
    for tick in range(1, 40):
        replies = rig.tick()
        parts += of(replies, "FILE_TRANSFER_PROTOCOL")
        heartbeats += len(of(replies, "HEARTBEAT"))
        attitudes += len(of(replies, "ATTITUDE"))
        assert len(parts) * FRAME_BYTES < 0.7 * 5760.0 * (0.1 * tick + 0.5)
    assert len(parts) >= len(CONTENT) // 239 - 1
    assert heartbeats == pytest.approx(4, abs=1)
    assert attitudes > 0


def test_blocked_link_does_not_keep_the_endpoint_busy(client):
    client.ask(OPEN, LOG)
    client.rig.transport.is_writable = False
    client.rig.give(client.rig.frame(client.request(BURST, size=1)))
    assert not client.rig.endpoint.busy
    client.rig.transport.is_writable = True
    client.rig.tick_silently()
    assert len(client.rig.give(b"")) > 100


@pytest.mark.parametrize(("sequence", "offset"), [(7, 0), (8, 640)])
def test_repeated_burst_continues_and_another_one_replaces_it(disk, stored, sequence, offset):
    rig, client = stored(byte_rate=5760.0, has_radio_rates=True)
    client.ask(OPEN, LOG)

    def offsets_after(number, first):
        replies = client.all(BURST, size=8, sequence=number, offset=first)
        replies += [reply for _ in range(5) for reply in client.replies(rig.tick())]
        return [reply.offset for reply in replies]

    before, after = offsets_after(7, 0), offsets_after(sequence, offset)
    assert before == list(range(0, before[-1] + 8, 8))
    assert before[-1] < 600
    if sequence == 7:
        assert after == list(range(before[-1] + 8, after[-1] + 8, 8))
    else:
        assert after[-1] > 640


def test_burst_of_a_file_that_has_become_shorter_ends(disk, stored):
    rig, client = stored(byte_rate=5760.0, has_radio_rates=True)
    client.ask(OPEN, LOG)
    client.all(BURST, size=8)
    os.truncate(disk / LOG, 0)
    assert len(client.replies(rig.ticks(20))) < 9  # those that were queued
    with (disk / LOG).open("r+b") as log:
        log.write(CONTENT)
    assert client.replies(rig.ticks(20)) == []
    client.all(BURST, size=8)
    assert len(client.replies(rig.ticks(20))) > 9


def test_session_of_a_long_burst_remains_open(disk, stored):
    rig, client = stored(byte_rate=300.0, has_radio_rates=True)

    def replies_after(opcode, seconds, **fields):
        replies = client.all(opcode, LOG if opcode == OPEN else b"", **fields)
        replies += [reply for _ in range(seconds) for reply in client.replies(rig.tick(seconds=1.0))]
        return [reply.ok for reply in replies if reply.query == opcode]

    assert replies_after(OPEN, 60) == [True]
    assert len(replies_after(BURST, 130, size=8)) > 60
    assert replies_after(READ, 60, size=4) == [True]
