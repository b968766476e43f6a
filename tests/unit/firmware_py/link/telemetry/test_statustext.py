"""Texts in chunks, and not too many."""

import pytest

from firmware_py.common.records import Severity
from firmware_py.link.telemetry.statustext import TextLimiter, text_messages


def joined(messages):
    return "".join(message.text for message in messages)


@pytest.mark.parametrize("length", [0, 1, 49, 50, 51, 99, 100, 101, 249, 250])
def test_a_text_arrives_whole_and_its_end_is_marked(length):
    text = ("The rudder servo not responding. " * 9)[:length]
    messages = text_messages(Severity.WARNING, text, 7)
    assert joined(messages) == text
    if length <= 50:
        assert [(message.id, message.chunk_seq) for message in messages] == [(0, 0)]
    else:
        assert [(message.id, message.chunk_seq) for message in messages] == [(7, n) for n in range(len(messages))]
        assert len(messages[-1].text) < 50


def test_an_endless_text_is_cut():
    assert len(joined(text_messages(Severity.INFO, "x" * 10_000, 1))) == 250


def test_the_same_text_is_not_repeated_at_once():
    notices = TextLimiter()
    assert [notices.admit("no", t_s) for t_s in (10.0, 10.1, 11.9, 12.1)] == [True, False, False, True]


def test_what_a_stream_is_refused_for_is_said_seldomer_until_the_stream_ends():
    notices = TextLimiter()
    hour_s = [number * 0.1 for number in range(36_000)]
    sent_s = [t_s for t_s in hour_s if notices.admit("no", t_s)]
    assert sent_s[:4] == pytest.approx([0.0, 2.0, 6.0, 14.0], abs=0.11)
    assert len(sent_s) < 70
    assert notices.admit("no", 4000.0)  # another one
    assert notices.admit("no", 4002.0)


def test_an_operator_who_tries_again_is_reported_each_time():
    notices = TextLimiter()
    assert all(notices.admit("no", 3.0 * number) for number in range(20))


def test_many_different_texts_are_held_to_two_a_second():
    notices = TextLimiter()
    replies = sum(notices.admit(f"text {number}", 100.0 + number * 1e-3) for number in range(10_000))
    assert replies == pytest.approx(8 + 2 * 10, abs=1)
    assert len(notices._sent_texts) <= 32
