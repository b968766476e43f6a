"""What leaves, in which order, and never faster than the line."""

import random

from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import Codec
from firmware_py.link.wire.outbox import Outbox, Priority

CODEC = Codec(1, 1)


def message(text=b"x" * 40):
    return CODEC.pack(mavlink.MAVLink_statustext_message(4, text))


class Line:
    def __init__(self):
        self.data = b""
        self.is_writable = True

    def __call__(self, data):
        if self.is_writable:
            self.data += data
        return self.is_writable

    def frames(self):
        return mavlink.MAVLink(None).parse_buffer(self.data) or []


def test_sequence_numbers_have_no_gaps_even_where_messages_were_dropped():
    line = Line()
    outbox = Outbox(line, 100.0)
    for tick in range(100):
        for _ in range(4):
            outbox.push(message(), Priority.TELEMETRY)
        outbox.push(message(), Priority.URGENT)
        outbox.flush(tick * 0.5)
    numbers = [frame.get_seq() for frame in line.frames()]
    assert numbers == [number % 256 for number in range(len(numbers))]
    assert outbox.dropped > 0


def test_the_line_is_never_asked_for_more_than_it_carries():
    rnd = random.Random(5)
    line, now_s, rate = Line(), 0.0, 960.0
    outbox = Outbox(line, rate)
    sent = [(0.0, 0)]
    for _ in range(2000):
        now_s += rnd.expovariate(20.0)
        for priority in Priority:
            outbox.push(message(), priority)
        outbox.flush(now_s)
        sent.append((now_s, len(line.data)))
    for first in range(0, len(sent), 50):
        for last in range(first + 1, len(sent), 37):
            seconds = sent[last][0] - sent[first][0]
            assert sent[last][1] - sent[first][1] <= rate * seconds + 280.0
    assert len(line.data) > 0.9 * rate * now_s


def test_urgent_goes_first():
    line = Line()
    outbox = Outbox(line, None)
    for priority in (Priority.TELEMETRY, Priority.REPLY, Priority.URGENT):
        outbox.push(message(priority.name.encode()), priority)
    outbox.flush(0.0)
    assert [frame.text for frame in line.frames()] == ["URGENT", "REPLY", "TELEMETRY"]


def test_a_blocked_line_keeps_answers_drops_telemetry_and_loses_no_sequence_number():
    line = Line()
    outbox = Outbox(line, None)
    line.is_writable = False
    outbox.push(message(b"answer"), Priority.REPLY)
    outbox.push(message(b"telemetry"), Priority.TELEMETRY)
    outbox.flush(0.0)
    line.is_writable = True
    outbox.flush(1.0)
    assert [(frame.text, frame.get_seq()) for frame in line.frames()] == [("answer", 0)]


def test_what_could_not_leave_for_long_is_forgotten():
    line = Line()
    outbox = Outbox(line, None)
    line.is_writable = False
    outbox.push(message(b"old"), Priority.URGENT)
    outbox.flush(0.0)
    outbox.flush(60.0)
    line.is_writable = True
    outbox.push(message(b"new"), Priority.URGENT)
    outbox.flush(60.1)
    assert [frame.text for frame in line.frames()] == ["new"]


def test_the_queues_are_bounded():
    outbox = Outbox(lambda _: False, None)
    for _ in range(10_000):
        for priority in Priority:
            outbox.push(message(), priority)
    assert outbox.waiting(Priority.TELEMETRY) < 300
    assert outbox.dropped > 29_000
