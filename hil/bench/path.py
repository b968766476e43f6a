"""Following one heading from the compass to the servo: the bench's stamps joined to the onboard log."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from firmware_py.common.angles import degrees
from firmware_py.common.records import Inputs
from hil.bench.rig import MILLIDEGREES

EARLY_PERIODS = 0.25


@dataclass(frozen=True, slots=True)
class Passage:
    """One heading on its way: written at sentence_s, `whole_s` until the servo had the goal.

    `wait_s` of that passed between its arrival and the tick that was due, decoding included.
    """

    sentence_s: float
    whole_s: float
    wait_s: float

    def computing_s(self, decoding_s: float) -> float:
        """Return the way without the wait for the tick, apart from the part of it in which it was decoded."""
        return self.whole_s - max(0.0, self.wait_s - decoding_s)


def passages(log: Iterable[Inputs], sentences_s: Sequence[float], goals_s: Sequence[float]) -> list[Passage]:
    """Join each tick's newest heading with its sentence and with the first goal frame after the tick began.

    A heading that no tick used as its newest, or a tick without a goal frame before the
    next one, is left out. The two clocks differ by a constant: the least of all
    differences between a sentence's writing and its arrival is taken to be no time at all.
    That is known only as well as the machine is quiet, so a tick's frame is looked for from
    a quarter of a period before it, far after the frame of the tick before.
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
