"""Forms, priorities and queues of satellite messages."""

import hashlib
from itertools import islice

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.link.satellite.messages import (
    AuthenticatedFrame,
    FrameClassifier,
    Kind,
    MessageQueue,
    Window,
    open_short_form,
    shorten,
    split_batch,
)

STATION = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
REPORT = dict.fromkeys(mavlink.MAVLink_high_latency2_message.fieldnames, 0) | {"custom2": 2}  # valid heading


def report(**changes):
    return mavlink.MAVLink_high_latency2_message(**REPORT | changes).pack(STATION)


@pytest.mark.parametrize(
    "changes", [{"custom_mode": 1}, {"custom_mode": 256}, {"failure_flags": 1}, {"failure_flags": 256}, {"custom2": 3}]
)
def test_report_is_an_event_after_a_change_of_mode_arming_or_failures(changes):
    classifier = FrameClassifier()
    reports = [{}, {}, changes, changes, {}]
    kinds = [classifier.kind_of(report(**changes)) for changes in reports]
    assert kinds == [Kind.REPORT, Kind.REPORT, Kind.EVENT, Kind.REPORT, Kind.EVENT]


def test_other_values_of_a_report_are_no_event():
    classifier = FrameClassifier()
    others = {name: 1 for name in REPORT if name not in ("custom_mode", "failure_flags", "custom2")}
    assert [classifier.kind_of(report(**changes)) for changes in ({}, others, {"custom2": -2})] == [Kind.REPORT] * 3
    assert classifier.kind_of(mavlink.MAVLink_statustext_message(4, b"x").pack(STATION)) is Kind.EVENT
    assert classifier.kind_of(mavlink.MAVLink_command_ack_message(1, 0).pack(STATION)) is Kind.ANSWER


@pytest.mark.parametrize(
    ("message", "size"),
    [
        (mavlink.MAVLink_high_latency2_message(**REPORT), 50),  # MAVLink 1, which has a fixed length
        (mavlink.MAVLink_high_latency2_message(**REPORT | {"custom2": 0, "custom1": 0, "custom0": 1}), 50),
        (mavlink.MAVLink_high_latency2_message(**REPORT | {"custom2": 0, "climb_rate": 1}), 50),
        (mavlink.MAVLink_high_latency2_message(**REPORT | {"custom2": 0, "temperature_air": 1}), 49),
        (mavlink.MAVLink_command_ack_message(512, 3), 11),
        (mavlink.MAVLink_command_ack_message(512, 0), 11),
        (mavlink.MAVLink_statustext_message(4, b"x" * 37), 50),
        (mavlink.MAVLink_statustext_message(4, b"x" * 50), 50),
        (mavlink.MAVLink_statustext_message(4, b"short"), 18),
        (mavlink.MAVLink_statustext_message(0, b""), 13),
        (mavlink.MAVLink_ping_message(0, 7, 0, 0), 21),
    ],
)
def test_frame_has_its_shortest_form(message, size):
    """Fifty bytes cost one credit."""
    short = shorten(message.pack(STATION))
    assert len(short) == size
    is_mavlink1 = message.get_type() in ("COMMAND_ACK", "HIGH_LATENCY2") and size != 49
    assert short[0] == (0xFE if is_mavlink1 else 0xFD)
    (decoded,) = mavlink.MAVLink(None).parse_buffer(short)
    expected = message.to_dict()
    if "text" in expected:
        expected["text"] = expected["text"][:37]
    assert decoded.to_dict() == expected
    assert (decoded.get_srcSystem(), decoded.get_srcComponent(), decoded.get_seq()) == (1, 1, 0)


def test_only_the_first_chunk_of_a_text_is_sent():
    assert shorten(mavlink.MAVLink_statustext_message(4, b"x" * 50, 1, 1).pack(STATION)) is None
    assert shorten(mavlink.MAVLink_statustext_message(4, b"x" * 50, 1, 0).pack(STATION)) is not None


def test_batch_is_divided_into_frames_without_signatures():
    signer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    signer.signing.secret_key, signer.signing.sign_outgoing = bytes(32), True
    frames = [
        mavlink.MAVLink_ping_message(number, 0, 0, 0).pack(signer if number == 1 else STATION) for number in range(3)
    ]
    assert list(islice(split_batch(b"".join(frames)), 9)) == [frames[0], frames[1][:-13], frames[2]]


def test_queues_are_limited_and_the_newest_reports_remain():
    queue = MessageQueue()
    for kind in (Kind.EVENT, Kind.REPORT, Kind.ANSWER):
        for number in range(30):
            queue.offer(kind, bytes((kind, number)))
    assert (len(queue), queue.dropped) == (16 + 24 + 16, {Kind.EVENT: 14, Kind.REPORT: 6, Kind.ANSWER: 14})
    bundle = queue.compose(lambda _kind, _size: True)
    numbers = {kind: [frame[1] for frame_kind, frame in bundle.frames if frame_kind is kind] for kind in Kind}
    expected = {Kind.EVENT: list(range(16)), Kind.REPORT: list(range(29, 5, -1)), Kind.ANSWER: list(range(16))}
    assert numbers == {**expected, Kind.MAILBOX: []}
    queue.offer(Kind.REPORT, b"new")  # replaces one that is being sent
    queue.remove(bundle)
    assert queue.compose(lambda _kind, _size: True).content == b"new"


def test_message_has_at_most_340_bytes_and_what_the_budget_allows():
    queue = MessageQueue()
    frames = {Kind.EVENT: bytes(200), Kind.REPORT: bytes(141), Kind.ANSWER: bytes(140)}
    for kind, frame in frames.items():
        queue.offer(kind, frame)
    offers = []
    bundle = queue.compose(lambda kind, size: offers.append((kind, size)) or True)
    assert [kind for kind, _ in bundle.frames] == [Kind.EVENT, Kind.ANSWER]
    assert len(bundle.content) == 340
    assert offers == [(Kind.EVENT, 200), (Kind.ANSWER, 340)]
    assert [kind for kind, _ in queue.compose(lambda kind, _size: kind is Kind.REPORT).frames] == [Kind.REPORT]


def test_latest_128_numbers_are_stored_and_earlier_ones_count_as_used():
    window = Window()
    for number in range(2, 257, 2):
        window = window.with_number(number)
    assert (len(window.used), window.floor, window.admits(3), window.admits(4)) == (128, 0, True, False)
    window = window.with_number(131)
    assert (len(window.used), window.floor) == (128, 2)
    admitted = [number for number in range(1, 9) if window.admits(number)]
    assert admitted == [3, 5, 7]
    assert window.used == tuple(sorted(window.used))
    assert Window(floor=9, used=window.used).with_number(400).floor == 9


def test_age_counts_from_the_start_of_2015_in_hundredths_of_a_second():
    assert AuthenticatedFrame(0, b"").age_s(1_420_070_400.0) == 0.0
    assert AuthenticatedFrame(250, b"").age_s(1_420_070_500.0) == 97.5


@pytest.mark.parametrize(
    ("number", "payload", "refusal"),
    [
        (4, b"", None),  # message PING, whose payload has 14 bytes
        (4, bytes(13) + b"x", None),
        (4, bytes(14) + b"x", "unknown message"),
        (0xFFFF, b"x", "unknown message"),
    ],
)
def test_authentic_message_must_be_known(number, payload, refusal):
    covered = b"\xb5" + (250).to_bytes(5, "little") + bytes((255, 190)) + number.to_bytes(2, "little") + payload

    def compute_hmac(text):
        return hashlib.sha256(text).digest()

    hmac = compute_hmac(b"sbd short form 1" + b"300" + covered)[:8]
    opened = open_short_form(covered + hmac, "300", compute_hmac)
    assert open_short_form(covered + hmac, "301", compute_hmac) == "false code"
    assert open_short_form((covered + hmac)[:17], "300", compute_hmac) == "cut short"
    assert open_short_form(covered + hmac, "300", lambda _text: None) == "there is no key"
    if refusal is None:
        (decoded,) = mavlink.MAVLink(None).parse_buffer(opened.frame)
        assert (opened.number, decoded.get_msgId()) == (250, number)
        head = bytes((0xFD, max(1, len(payload)), 0, 0, 0, 255, 190))
        assert opened.frame[:10] == head + number.to_bytes(3, "little")
        assert decoded.target_component == (ord("x") if payload else 0)
    else:
        assert opened == refusal
