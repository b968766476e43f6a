"""Chunks of a STATUSTEXT, and limits of repeated texts."""

import pytest

from firmware_py.common.records import Event, Severity
from firmware_py.faults.table import TABLE, Fault
from firmware_py.link.telemetry.statustext import RecentWarnings, TextLimiter, text_messages


def join(messages):
    return "".join(message.text for message in messages)


@pytest.mark.parametrize("length", [0, 1, 49, 50, 51, 99, 100, 101, 249, 250])
def test_chunks_contain_the_text_and_mark_its_end(length):
    text = ("Rudder servo not responding. " * 9)[:length]
    messages = text_messages(Severity.WARNING, text, 7)
    assert join(messages) == text
    if length <= 50:
        assert [(message.id, message.chunk_seq) for message in messages] == [(0, 0)]
    else:
        assert [(message.id, message.chunk_seq) for message in messages] == [(7, n) for n in range(len(messages))]
        assert len(messages[-1].text) < 50


def test_long_text_is_truncated():
    assert len(join(text_messages(Severity.INFO, "x" * 10_000, 1))) == 250


@pytest.fixture
def limiter():
    return TextLimiter()


def test_equal_text_is_suppressed_for_two_seconds(limiter):
    assert [limiter.admit("no", t_s) for t_s in (10.0, 10.1, 11.9, 12.0)] == [True, False, False, True]


def test_repetitions_become_rarer_until_the_cause_ends(limiter):
    times_s = [number * 0.1 for number in range(36_000)]
    sent_s = [t_s for t_s in times_s if limiter.admit("no", t_s)]
    assert sent_s[:8] == pytest.approx([0.0, 2.0, 6.0, 14.0, 30.0, 62.0, 122.0, 182.0], abs=0.11)
    assert limiter.admit("no", 4000.0)
    assert limiter.admit("no", 4002.0)


def test_text_with_separate_causes_is_always_sent(limiter):
    assert all(limiter.admit("no", 3.0 * number) for number in range(20))


def test_rate_of_different_texts_is_limited(limiter):
    sent = sum(limiter.admit(f"text {number}", 100.0 + number * 1e-3) for number in range(10_000))
    assert sent == 8 + 2 * 10 - 1
    assert len(limiter._sent_texts) <= 32


@pytest.mark.parametrize(("age_s", "is_rarer"), [(3.875, True), (4.0, False)])
def test_cause_has_ended_after_two_intervals_without_the_text(limiter, age_s, is_rarer):
    assert [limiter.admit("no", t_s) for t_s in (0.0, 1.0, age_s)] == [True, False, True]
    assert limiter.admit("no", age_s + 2.0) is not is_rarer


@pytest.mark.parametrize(
    ("age_s", "prefix"),
    [
        (0.0, ""), (59.0, ""), (60.0, "1 min ago: "), (7199.0, "120 min ago: "), (7200.0, "2 h ago: "),
        (172_799.0, "48 h ago: "), (172_800.0, "2 d ago: "), (864_000.0, "10 d ago: "),
    ],
)  # fmt: skip
def test_warnings_have_their_age(age_s, prefix):
    warnings = RecentWarnings()
    warnings.add(Event(Severity.WARNING, "text"), 100.0)
    assert list(warnings.recent_events(100.0 + age_s)) == [Event(Severity.WARNING, f"{prefix}text")]


def test_last_five_warnings_are_stored_without_those_of_ended_faults():
    warnings, fault = RecentWarnings(), TABLE[Fault.COMPASS_LOST]
    texts = ["first", fault.text, *map(str, range(4))]
    for text in texts:
        warnings.add(Event(Severity.WARNING, text), 0.0)
    warnings.add(Event(Severity.NOTICE, "notice"), 0.0)
    assert [event.text for event in warnings.recent_events(0.0)] == texts[1:]
    warnings.add(Event(Severity.NOTICE, fault.recovery), 0.0)
    assert [event.text for event in warnings.recent_events(0.0)] == texts[2:]
    for text in "abcd":
        warnings.add(Event(Severity.ERROR, text), 0.0)
    assert [event.text for event in warnings.recent_events(0.0)] == ["3", "a", "b", "c", "d"]
