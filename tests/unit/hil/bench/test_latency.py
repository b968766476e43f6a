"""Joining the bench's stamps with the onboard log."""

import math

import pytest

from firmware_py.common.records import HeadingSample, Inputs, NorthReference, Tick
from hil.bench.latency import Passage, passages, sense_figures

AHEAD_S = 100.0  # the bench's clock is this much ahead of the autopilot's


def tick(due_s, *headings, late_s=0.0):
    """A tick on the autopilot's clock that takes (arrival, n-th heading) pairs."""
    samples = tuple(
        HeadingSample(arrival_s, math.radians(number / 1000.0), NorthReference.TRUE) for arrival_s, number in headings
    )
    return Inputs(Tick(0, due_s, late_s, 0, 10.0), samples)


def on_bench(*times_s):
    return [AHEAD_S + t_s for t_s in times_s]


def test_heading_to_frame():
    log = [tick(1.002, (1.0, 1), late_s=0.0001), tick(1.102, (1.1, 2))]
    found = passages(log, on_bench(1.0, 1.0999), on_bench(1.0026, 1.1031))
    # The quickest arrival (the first) is taken to be no time at all.
    assert found == [
        Passage(pytest.approx(AHEAD_S + 1.0), pytest.approx(0.0026), pytest.approx(0.002)),
        Passage(pytest.approx(AHEAD_S + 1.0999), pytest.approx(0.0032), pytest.approx(0.002)),
    ]


def test_frame_before_the_tick():
    # The heading comes just after a tick has begun; that tick's frame follows at once and knows nothing of it.
    log = [tick(1.0, (0.95, 1)), tick(1.1, (1.001, 2))]
    found = passages(log, on_bench(0.95, 1.001), on_bench(1.0015, 1.1005))
    assert [passage.whole_s for passage in found] == pytest.approx([0.0515, 0.0995])


def test_one_early_stamp():
    # The autopilot was held up between its stamp and its read: this heading seems to arrive before it was sent.
    log = [tick(1.0, (0.995, 1)), tick(1.1, (1.095, 2)), tick(1.2, (1.195, 3))]
    found = passages(log, on_bench(0.995, 1.1, 1.195), on_bench(1.0005, 1.1005, 1.2005))
    assert [passage.whole_s for passage in found] == pytest.approx([0.0055, 0.0005, 0.0055])


def test_newer_of_two_headings():
    found = passages([tick(1.0, (0.85, 1), (0.95, 2))], on_bench(0.85, 0.95), on_bench(1.001))
    assert [passage.sentence_s for passage in found] == [AHEAD_S + 0.95]


def test_tick_without_frame_or_heading():
    log = [tick(1.0), tick(1.1, (1.05, 1)), tick(1.2, (1.15, 2))]
    found = passages(log, on_bench(1.05, 1.15), on_bench(1.2005))
    assert [passage.sentence_s for passage in found] == [AHEAD_S + 1.15]
    assert passages([tick(1.0)], on_bench(0.9), on_bench(1.1)) == []
    assert passages([], [], []) == []


def test_unknown_heading():
    assert passages([tick(1.0, (0.95, 7))], on_bench(0.95), on_bench(1.0)) == []


def test_figures_with_and_without_the_wait():
    whole, late, computing = sense_figures([Passage(1.0, 0.003, 0.001), Passage(2.0, 0.007, 0.001)])
    assert (whole.value, late.value, computing.value) == pytest.approx((5.0, 6.8, 4.0))
    assert [figure.met for figure in (whole, late, computing)] == [True, None, None]
