"""Order, rate and capacity of the messages to one peer, and the share for long transfers."""

import random

import pytest

from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import Codec
from firmware_py.link.wire.outbox import BulkShare, Outbox, Priority, RadioRate

CODEC = Codec(1, 1)
FRAME_BYTES = 110


def message(text=b"x" * 40):
    return CODEC.pack(mavlink.MAVLink_statustext_message(4, text))


class Line:
    """Function that sends data: stores it while `is_writable`, otherwise returns False."""

    def __init__(self):
        self.data = b""
        self.sizes = []  # of the datagrams
        self.is_writable = True

    def __call__(self, data):
        if self.is_writable:
            self.data += data
            self.sizes.append(len(data))
            assert len(self.sizes) < 10_000, "it sends without end"
        return self.is_writable

    def frames(self):
        return mavlink.MAVLink(None).parse_buffer(self.data) or []


@pytest.fixture
def line():
    return Line()


@pytest.fixture
def outbox(line):
    return Outbox(line, None)


def test_dropped_messages_leave_no_gaps_in_the_sequence_numbers(line):
    outbox = Outbox(line, 100.0)
    for tick in range(100):
        for _ in range(4):
            outbox.push(message(), Priority.TELEMETRY)
        outbox.push(message(), Priority.URGENT)
        outbox.flush(tick * 0.5)
    numbers = [frame.get_seq() for frame in line.frames()]
    assert numbers == [number % 256 for number in range(len(numbers))]
    assert outbox.dropped > 0


def test_rate_of_a_line_is_used_and_not_exceeded(line):
    rng = random.Random(5)
    now_s, rate = 0.0, 960.0
    outbox = Outbox(line, rate)
    sent = [(0.0, 0)]
    for _ in range(2000):
        now_s += rng.expovariate(20.0)
        for priority in Priority:
            outbox.push(message(), priority)
        outbox.flush(now_s)
        sent.append((now_s, len(line.data)))
    for first in range(0, len(sent), 50):
        for last in range(first + 1, len(sent), 37):
            seconds = sent[last][0] - sent[first][0]
            assert sent[last][1] - sent[first][1] <= rate * seconds + 280.0
    assert len(line.data) > 0.9 * rate * now_s


def test_messages_are_sent_in_order_of_priority(line, outbox):
    for priority in (Priority.TELEMETRY, Priority.REPLY, Priority.URGENT):
        outbox.push(message(priority.name.encode()), priority)
    outbox.flush(0.0)
    assert [frame.text for frame in line.frames()] == ["URGENT", "REPLY", "TELEMETRY"]


def test_blocked_line_keeps_replies_and_drops_telemetry(line, outbox):
    line.is_writable = False
    outbox.push(message(b"reply"), Priority.REPLY)
    outbox.push(message(b"telemetry"), Priority.TELEMETRY)
    outbox.flush(0.0)
    line.is_writable = True
    outbox.flush(1.0)
    assert [(frame.text, frame.get_seq()) for frame in line.frames()] == [("reply", 0)]


@pytest.mark.parametrize(("blocked_s", "is_kept"), [(3.0, True), (3.1, False)])
def test_messages_are_dropped_after_a_line_was_blocked_for_three_seconds(line, outbox, blocked_s, is_kept):
    line.is_writable = False
    outbox.push(message(b"old"), Priority.URGENT)
    outbox.flush(64.0)
    outbox.flush(64.0 + blocked_s)
    line.is_writable = True
    outbox.push(message(b"new"), Priority.URGENT)
    outbox.flush(128.0)
    assert [frame.text for frame in line.frames()] == ["old", "new"][not is_kept :]


@pytest.mark.parametrize(("last_text", "sizes"), [(b"x" * 47, [1200]), (b"x" * 48, [1140, 61])])
def test_datagram_has_at_most_1200_bytes(line, outbox, last_text, sizes):
    for text in [b"x" * 47] * 19 + [last_text]:
        outbox.push(message(text), Priority.REPLY)
    outbox.flush(0.0)
    assert line.sizes == sizes
    assert outbox.sent_bytes == sum(sizes)


@pytest.mark.parametrize(("byte_rate", "count"), [(4800.0, 20), (100.0, 4), (1e6, 90)])
def test_idle_line_accumulates_a_quarter_second_or_a_frame_of_280_bytes(line, byte_rate, count):
    outbox = Outbox(line, byte_rate)
    for _ in range(90):
        outbox.push(message(b"x" * 47), Priority.REPLY)
    outbox.flush(100.0)
    assert len(line.data) == 60 * count


@pytest.mark.parametrize(("byte_rate", "available_bytes"), [(4800.0, 1200.0 - 180.0), (None, 4800.0)])
def test_available_bytes_of_a_line_exclude_the_queued_ones(line, byte_rate, available_bytes):
    outbox = Outbox(line, byte_rate)
    for priority in Priority:
        outbox.push(message(b"x" * 47), priority)
    assert outbox.available_bytes(10.0) == available_bytes


def test_credit_limits_the_queued_bytes(outbox):
    outbox.credit_bytes = 179
    assert outbox.frames_in_credit(60) == 2
    assert outbox.available_bytes(0.0) == 0.0
    for text_bytes, credit_bytes, dropped in ((47, 119, 0), (47, 59, 0), (47, 59, 1), (46, 0, 1), (1, 0, 2)):
        outbox.push(message(b"x" * text_bytes), Priority.URGENT)
        assert (outbox.credit_bytes, outbox.dropped) == (credit_bytes, dropped)
    assert outbox.queued_count(Priority.URGENT) == 3


def test_transfer_over_a_network_continues_at_once_while_no_reply_is_queued():
    share = BulkShare(None)
    assert share.max_frames(FRAME_BYTES, 0, 0.0) == 44  # four datagrams
    assert share.max_frames(FRAME_BYTES, 1, 0.0) == 0
    share.mark_unfinished()
    assert share.can_continue


@pytest.mark.parametrize("byte_rate", [120.0, 960.0, 5760.0, 92160.0])
def test_transfer_over_a_line_uses_70_percent_of_its_rate(byte_rate):
    share, sent = BulkShare(byte_rate), 0
    for tick in range(600):
        frames = share.max_frames(FRAME_BYTES, 0, 0.1 * tick)
        share.spend(frames * FRAME_BYTES)
        sent += frames * FRAME_BYTES
    assert sent == pytest.approx(0.7 * byte_rate * 60.0, rel=0.05)
    share.mark_unfinished()
    assert not share.can_continue


def test_transfer_accumulates_a_quarter_second_on_an_idle_line_and_nothing_without_time():
    share = BulkShare(5760.0)
    assert share.max_frames(FRAME_BYTES, 0, 0.0) == 0
    assert share.max_frames(FRAME_BYTES, 0, 1e6) == 0.7 * 0.25 * 5760.0 // FRAME_BYTES
    share.spend(10 * FRAME_BYTES)
    assert share.max_frames(FRAME_BYTES, 0, 1e6) <= 0
    assert share.max_frames(FRAME_BYTES, 0, 0.0) <= 0
    assert BulkShare(120.0).max_frames(10, 0, 1e6) == 8  # of one second; its quarter is shorter than a frame
    assert BulkShare(120.0).max_frames(10, 0, 1.1) == 8


@pytest.mark.parametrize(
    ("free_percent", "shares"),
    [
        (0, [0.5, 0.25, 0.125, 0.125]),  # at least 120 bytes/s
        (19, [0.5, 0.25]),
        (20, [0.8, 0.64]),
        (49, [0.8, 0.64]),
        (50, [1.0, 1.0]),
        (90, [1.0, 1.0]),
        (-1, [1.0, 1.0]),
        (101, [1.0, 1.0]),
        (255, [1.0, 1.0]),
    ],
)
def test_share_of_the_rate_follows_the_free_buffer_of_the_modem(free_percent, shares):
    rate, slow, network = RadioRate(960.0), RadioRate(60.0), RadioRate(None)
    for share in shares:
        for each in (rate, slow, network):
            each.update(free_percent, 5.0)
        assert (rate.share, slow.share, network.share) == (pytest.approx(share), 1.0, 1.0)
    for free, factor in ((91, 1.15), (100, 1.15**2), (90, 1.15**2), (101, 1.15**2)):
        rate.update(free, 6.0 if free <= 100 else 9.0)
        assert rate.share == pytest.approx(min(1.0, shares[-1] * factor))
    was_reduced = rate.share < 1.0
    assert not rate.reset_after_silence(16.0)
    assert rate.reset_after_silence(16.1) is was_reduced
    assert rate.share == 1.0


def test_queued_replies_reduce_the_frames_of_a_transfer():
    share = BulkShare(1e6)
    share.max_frames(FRAME_BYTES, 0, 0.0)
    assert share.max_frames(FRAME_BYTES, 60, 10.0) == 4
    assert share.max_frames(FRAME_BYTES, 64, 10.0) == 0


def test_every_tenth_heartbeat_to_a_peer_of_mavlink1_is_also_sent_in_mavlink2(line, outbox):
    outbox.is_mavlink1_only = True
    for number in range(30):
        outbox.push(CODEC.pack(mavlink.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3)), Priority.URGENT)
        outbox.flush(0.0)
        markers = {frame.get_msgbuf()[0] for frame in line.frames()}
        line.data = b""
        assert markers == ({0xFE, 0xFD} if number % 10 == 9 else {0xFE})


@pytest.mark.parametrize(("priority", "size"), [(Priority.URGENT, 64), (Priority.REPLY, 128), (Priority.TELEMETRY, 64)])
def test_each_queue_has_its_size(line, outbox, priority, size):
    line.is_writable = False
    for _ in range(size):
        outbox.push(message(), priority)
    assert outbox.dropped == 0
    outbox.push(message(), priority)
    assert outbox.dropped == 1
