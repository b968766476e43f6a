"""Chunks of a STATUSTEXT, and limits of repeated texts."""

import pytest

from firmware_py.common.records import Severity
from firmware_py.link.telemetry.statustext import TextLimiter, text_messages


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
    assert [limiter.admit("no", t_s) for t_s in (10.0, 10.1, 11.9, 12.1)] == [True, False, False, True]


def test_repetitions_become_rarer_until_the_cause_ends(limiter):
    times_s = [number * 0.1 for number in range(36_000)]
    sent_s = [t_s for t_s in times_s if limiter.admit("no", t_s)]
    assert sent_s[:4] == pytest.approx([0.0, 2.0, 6.0, 14.0], abs=0.11)
    assert len(sent_s) < 70
    assert limiter.admit("no", 4000.0)
    assert limiter.admit("no", 4002.0)


def test_text_with_separate_causes_is_always_sent(limiter):
    assert all(limiter.admit("no", 3.0 * number) for number in range(20))


def test_rate_of_different_texts_is_limited(limiter):
    sent = sum(limiter.admit(f"text {number}", 100.0 + number * 1e-3) for number in range(10_000))
    assert sent == pytest.approx(8 + 2 * 10, abs=1)
    assert len(limiter._sent_texts) <= 32
