"""Matching of sentences, ticks and servo frames."""

import math

import pytest

from firmware_py.common.records import HeadingSample, Inputs, NorthReference, Tick
from hil.bench.latency import HeadingLatency, match_latencies, sense_figures

OFFSET_S = 100.0  # clock of the bench minus that of the autopilot


def tick(due_s, *headings, late_s=0.0):
    """Return the inputs of a tick with headings of (arrival, number) pairs, on the clock of the autopilot."""
    samples = tuple(
        HeadingSample(arrival_s, math.radians(number / 1000.0), NorthReference.TRUE) for arrival_s, number in headings
    )
    return Inputs(Tick(0, due_s, late_s, 0, 10.0), samples)


def on_bench(*times_s):
    return [OFFSET_S + t_s for t_s in times_s]


def test_latency_is_from_sentence_to_frame():
    log = [tick(1.002, (1.0, 1), late_s=0.0001), tick(1.102, (1.1, 2))]
    latencies = match_latencies(log, on_bench(1.0, 1.0999), on_bench(1.0026, 1.1031))
    # The first sentence, with the fastest arrival, defines the offset of the clocks.
    assert latencies == [
        HeadingLatency(pytest.approx(OFFSET_S + 1.0), pytest.approx(0.0026), pytest.approx(0.002)),
        HeadingLatency(pytest.approx(OFFSET_S + 1.0999), pytest.approx(0.0032), pytest.approx(0.002)),
    ]


def test_frame_of_an_earlier_tick_is_not_matched():
    # The second heading arrives after the start of the first tick and before its frame.
    log = [tick(1.0, (0.95, 1)), tick(1.1, (1.001, 2))]
    latencies = match_latencies(log, on_bench(0.95, 1.001), on_bench(1.0015, 1.1005))
    assert [latency.total_s for latency in latencies] == pytest.approx([0.0515, 0.0995])


def test_arrival_before_the_sentence_is_matched():
    # The second heading seems to arrive before it was sent, as after a delay between time stamp and read.
    log = [tick(1.0, (0.995, 1)), tick(1.1, (1.095, 2)), tick(1.2, (1.195, 3))]
    latencies = match_latencies(log, on_bench(0.995, 1.1, 1.195), on_bench(1.0005, 1.1005, 1.2005))
    assert [latency.total_s for latency in latencies] == pytest.approx([0.0055, 0.0005, 0.0055])


def test_newest_heading_of_a_tick_is_matched():
    latencies = match_latencies([tick(1.0, (0.85, 1), (0.95, 2))], on_bench(0.85, 0.95), on_bench(1.001))
    assert [latency.sentence_s for latency in latencies] == [OFFSET_S + 0.95]


def test_tick_without_frame_or_heading_is_omitted():
    log = [tick(1.0), tick(1.1, (1.05, 1)), tick(1.2, (1.15, 2))]
    latencies = match_latencies(log, on_bench(1.05, 1.15), on_bench(1.2005))
    assert [latency.sentence_s for latency in latencies] == [OFFSET_S + 1.15]
    assert match_latencies([tick(1.0)], on_bench(0.9), on_bench(1.1)) == []
    assert match_latencies([], [], []) == []


def test_unknown_heading_is_omitted():
    assert match_latencies([tick(1.0, (0.95, 7))], on_bench(0.95), on_bench(1.0)) == []


def test_figures_have_percentiles_with_and_without_the_wait():
    median, p95, computing = sense_figures([HeadingLatency(1.0, 0.003, 0.001), HeadingLatency(2.0, 0.007, 0.001)])
    assert (median.value, p95.value, computing.value) == pytest.approx((5.0, 6.8, 4.0))
    assert [figure.met for figure in (median, p95, computing)] == [True, None, None]
