"""The latency from a compass sentence to the servo frame that it decides.

The stamps of the bench on sentences and frames are joined to the onboard log, which has the tick of each heading.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from firmware_py.common.angles import degrees
from firmware_py.common.records import Inputs
from hil.bench.figure import Figure, Finding, percentile
from hil.bench.machine import steady
from hil.bench.rig import COMPASS_HZ, MILLIDEGREES, Rig
from hil.bench.setting import Setting
from hil.bench.tick import logged
from hil.errors import HilError

MILLISECONDS = 1e3
MAX_LATENCY_MS = 5.0
START_TIMEOUT_S = 60.0
EARLY_PERIODS = 0.25


@dataclass(frozen=True, slots=True)
class Passage:
    """One heading: its sentence was written at `sentence_s`, the servo received the goal `whole_s` later.

    Of that, `wait_s` passed between the arrival of the heading and the deadline of the tick.
    """

    sentence_s: float
    whole_s: float
    wait_s: float


def sense(setting: Setting) -> Finding:
    """Simulate compass and servo, and follow each heading from its sentence to the servo frame."""
    with Rig(setting.directory / "sense") as rig, steady():
        rig.serve_until_alive(START_TIMEOUT_S)
        counted_from_s = rig.now_s() + setting.lock_s
        rig.serve(counted_from_s + setting.sense_s)
    found = passages(logged(rig.out), rig.sentences_s, rig.goals_s)
    counted = [passage for passage in found if passage.sentence_s >= counted_from_s]
    if not counted:
        raise HilError("no heading was followed to the servo; see the onboard log")
    notes = (
        f"{len(counted)} headings of a free-running {COMPASS_HZ:g} Hz NMEA compass, identified in the onboard log",
        f"counted from {setting.lock_s:g} s after the first goal, when the ticks have locked to the compass",
    )
    return Finding("From compass to servo", sense_figures(counted), notes)


def sense_figures(counted: Sequence[Passage]) -> tuple[Figure, ...]:
    """Return percentiles of the whole path, and of the path without the wait for the tick."""
    whole_ms = [passage.whole_s * MILLISECONDS for passage in counted]
    computing_ms = [(passage.whole_s - passage.wait_s) * MILLISECONDS for passage in counted]
    return (
        Figure("whole path, p50", "ms", percentile(whole_ms, 50.0), maximum=MAX_LATENCY_MS, peer="pypilot 26"),
        Figure("whole path, p95", "ms", percentile(whole_ms, 95.0)),
        Figure("without the wait for the tick, p50", "ms", percentile(computing_ms, 50.0)),
    )


def passages(log: Iterable[Inputs], sentences_s: Sequence[float], goals_s: Sequence[float]) -> list[Passage]:
    """Join each tick's newest heading with its sentence and with the first goal frame after the start of the tick.

    A heading that is not the newest of any tick is left out, and so is a tick without a goal frame before the next
    tick. The two clocks differ by a constant: the smallest difference between the writing of a sentence and its
    arrival counts as no time. As that is known only as well as the machine is quiet, the frame of a tick is searched
    from a quarter of a period before the tick, long after the frame of the previous tick.
    """
    used = [used for inputs in log if (used := _used(inputs, sentences_s)) is not None]
    if not used:
        return []
    offset_s = max(sentence_s - inputs.headings[-1].t_s for inputs, sentence_s in used)
    found = []
    for inputs, sentence_s in used:
        tick = inputs.tick
        begin_s = tick.t_s + tick.late_s + offset_s
        period_s = 1.0 / tick.rate_hz
        from_s = begin_s - EARLY_PERIODS * period_s
        index = bisect_left(goals_s, from_s)
        if index < len(goals_s) and goals_s[index] < from_s + period_s:
            wait_s = max(0.0, tick.t_s - inputs.headings[-1].t_s)
            found.append(Passage(sentence_s, goals_s[index] - sentence_s, wait_s))
    return found


def _used(inputs: Inputs, sentences_s: Sequence[float]) -> tuple[Inputs, float] | None:
    if not inputs.headings:
        return None
    number = round(degrees(inputs.headings[-1].heading_rad) * MILLIDEGREES)
    return (inputs, sentences_s[number - 1]) if 1 <= number <= len(sentences_s) else None
