"""The latency from a compass sentence to the servo frame that is computed from it.

The times of sentences and frames are matched with the onboard log, which contains the tick of each heading.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from firmware_py.common.angles import degrees
from firmware_py.common.records import Inputs
from hil.bench.figure import Figure, Finding, percentile
from hil.bench.machine import autopilot_scheduling
from hil.bench.rig import COMPASS_HZ, MILLIDEGREES, Rig
from hil.bench.setting import Setting
from hil.bench.tick import logged_inputs
from hil.errors import HilError

MILLISECONDS = 1e3
MAX_LATENCY_MS = 5.0
START_TIMEOUT_S = 60.0
SEARCH_PERIODS = 0.25


@dataclass(frozen=True, slots=True)
class HeadingLatency:
    """Latency of a heading: its sentence was written at `sentence_s`, the servo received the goal `total_s` later.

    `wait_s` of it is the time from the arrival of the heading to the deadline of the tick.
    """

    sentence_s: float
    total_s: float
    wait_s: float


def sense(setting: Setting) -> Finding:
    """Simulate compass and servo, and measure the latency of each heading."""
    with Rig(setting.directory / "sense") as rig, autopilot_scheduling():
        rig.serve_until_alive(START_TIMEOUT_S)
        measure_from_s = rig.now_s() + setting.lock_s
        rig.serve(measure_from_s + setting.sense_s)
    latencies = match_latencies(logged_inputs(rig.out), rig.sentences_s, rig.goals_s)
    measured = [latency for latency in latencies if latency.sentence_s >= measure_from_s]
    if not measured:
        raise HilError("no heading was followed to the servo; see the onboard log")
    notes = (
        f"{len(measured)} headings of a free-running {COMPASS_HZ:g} Hz NMEA compass, identified in the onboard log",
        f"counted from {setting.lock_s:g} s after the first goal, when the ticks have locked to the compass",
    )
    return Finding("From compass to servo", sense_figures(measured), notes)


def sense_figures(measured: Sequence[HeadingLatency]) -> tuple[Figure, ...]:
    """Return percentiles of the latency, with and without the wait for the tick."""
    total_ms = [latency.total_s * MILLISECONDS for latency in measured]
    computing_ms = [(latency.total_s - latency.wait_s) * MILLISECONDS for latency in measured]
    return (
        Figure("whole path, p50", "ms", percentile(total_ms, 50.0), maximum=MAX_LATENCY_MS, peer="pypilot 26"),
        Figure("whole path, p95", "ms", percentile(total_ms, 95.0)),
        Figure("without the wait for the tick, p50", "ms", percentile(computing_ms, 50.0)),
    )


def match_latencies(
    log: Iterable[Inputs], sentences_s: Sequence[float], goals_s: Sequence[float]
) -> list[HeadingLatency]:
    """Match the newest heading of each tick with its sentence and with the first goal frame after the tick starts.

    Headings that are not the newest of a tick are omitted, and so are ticks without a goal frame before the next tick.
    The two clocks differ by a constant, which is estimated from the fastest arrival of a sentence. The load of the
    machine changes this estimate, so the frame of a tick is searched from a quarter of a period before the tick.
    """
    matched = [pair for inputs in log if (pair := _match_sentence(inputs, sentences_s)) is not None]
    if not matched:
        return []
    offset_s = max(sentence_s - inputs.headings[-1].t_s for inputs, sentence_s in matched)
    latencies = []
    for inputs, sentence_s in matched:
        tick = inputs.tick
        begin_s = tick.t_s + tick.late_s + offset_s
        period_s = 1.0 / tick.rate_hz
        from_s = begin_s - SEARCH_PERIODS * period_s
        index = bisect_left(goals_s, from_s)
        if index < len(goals_s) and goals_s[index] < from_s + period_s:
            wait_s = max(0.0, tick.t_s - inputs.headings[-1].t_s)
            latencies.append(HeadingLatency(sentence_s, goals_s[index] - sentence_s, wait_s))
    return latencies


def _match_sentence(inputs: Inputs, sentences_s: Sequence[float]) -> tuple[Inputs, float] | None:
    if not inputs.headings:
        return None
    number = round(degrees(inputs.headings[-1].heading_rad) * MILLIDEGREES)
    return (inputs, sentences_s[number - 1]) if 1 <= number <= len(sentences_s) else None
