"""Which heading source is steered by: compass A, compass B, or as a last resort the course over ground.

Each compass is judged by itself: it must speak, change, and stay within the filter's gate. The first
sound one in order is in use. A change of source never moves the rudder: the new source starts with
the offset at which it agrees with the estimate, and the offset is slewed away. A compass comes back
only after it has been sound and in agreement for a while.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Event, Severity
from firmware_py.estimate.stay import SPIN_NOISE_RAD, SPIN_RAD_S, STAYED_S, Stay, stays
from firmware_py.estimate.wave_filter_state import Heading

JUMP_RAD: Final = radians(20.0)  # the gate of the filter: what it refuses is not sound
JUMP_S: Final = 1.5
FIRST_JUMP_S: Final = 1.0  # what a first heading far off counts at most: one alone is no jump, however slow the compass
PROBATION_S: Final = 10.0
CONTRADICTED_S: Final = 60.0
SLEW_RAD_S: Final = radians(0.5)
DISAGREEMENT_RAD: Final = radians(15.0)
SMOOTHING_S: Final = 10.0
LEAST_STAND_S: Final = 1.5
STANDS: Final = 2.0  # times as long as it has shown one number so far, and it stands still
FIRST_LONGEST_S: Final = 1.0
LONGEST_MEMORY_S: Final = 600.0


class Source(IntEnum):
    """What the heading is taken from."""

    COMPASS_A = 0
    COMPASS_B = 1
    COURSE = 2
    NONE = 3


NAMES: Final = ("compass A", "compass B", "course over ground", "no heading source")


class TrueHeadingSample(msgspec.Struct, frozen=True):
    """One heading from true north of compass A (0) or B (1), with the number that the device gave."""

    t_s: float
    heading_rad: float
    raw_rad: float
    source: int


class SourceSettings(msgspec.Struct, frozen=True):
    """After how long a compass that shows the same number has stopped measuring (0: never)."""

    frozen_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> SourceSettings:
        """Read the settings from the parameters."""
        return cls(frozen_s=parameters["CMP_FROZEN_S"])


class CompassState(msgspec.Struct, frozen=True):
    """What a compass has shown.

    `changed_s` is when its number last changed, `near_s` when it last lay within the gate around the
    estimate, `sound_since_s` since when it has been sound; `difference_rad` is its smoothed difference
    from the estimate, `offset_rad` what is still added to it after a change of source. `longest_s` is for how long it
    shows one number at most, of late; `contradicted`: it shows the same although she must have turned.
    `steady_rad` is its difference smoothed also beyond the gate, None while it does not measure; `agreed`: that was
    small when it last lay within the gate, so that it has jumped when it does no more. `heading_rad` is what it
    showed last, `stay` where it stays beyond the gate, None within.
    """

    t_s: float | None = None
    raw_rad: float | None = None
    changed_s: float = 0.0
    near_s: float = 0.0
    sound_since_s: float | None = None
    difference_rad: float = 0.0
    offset_rad: float = 0.0
    longest_s: float = FIRST_LONGEST_S
    contradicted: bool = False
    steady_rad: float | None = None
    agreed: bool = False
    heading_rad: float = 0.0
    stay: Stay | None = None

    def speaks(self, now_s: float, timeout_s: float) -> bool:
        """Whether it is not silent."""
        return self.t_s is not None and now_s - self.t_s <= timeout_s

    def frozen(self, now_s: float, settings: SourceSettings, timeout_s: float) -> bool:
        """Whether it speaks but has not changed for too long, or not while she turned."""
        return self.speaks(now_s, timeout_s) and self.stood(settings)

    def stood(self, settings: SourceSettings) -> bool:
        """Whether it had not changed for too long, or not while she turned, when it spoke last."""
        if self.t_s is None or settings.frozen_s == 0.0:
            return False
        return self.contradicted or self.t_s - self.changed_s > settings.frozen_s

    @property
    def beyond_its_way(self) -> float:
        """How many times as long it has shown one number as is still its way."""
        shown_s = 0.0 if self.t_s is None else self.t_s - self.changed_s
        return shown_s / max(LEAST_STAND_S, STANDS * self.longest_s)

    def jumping(self) -> bool:
        """Whether it shows headings that the boat cannot have come to."""
        return self.t_s is not None and self.t_s - self.near_s > JUMP_S


class SourceState(msgspec.Struct, frozen=True):
    """The compasses and the source in use."""

    compasses: tuple[CompassState, CompassState] = (CompassState(), CompassState())
    in_use: Source = Source.NONE

    @property
    def shown_rad(self) -> float | None:
        """What the compass in use shows, as it gives it; None without one."""
        return self.compasses[self.in_use].raw_rad if self.in_use in (Source.COMPASS_A, Source.COMPASS_B) else None

    def disagree(self) -> bool:
        """Whether two compasses that measure differ by more than they should."""
        a, b = (compass.steady_rad for compass in self.compasses)
        return a is not None and b is not None and abs(wrap_pi(a - b)) > DISAGREEMENT_RAD


def needs_restart(state: SourceState, now_s: float, timeouts_s: tuple[float, float]) -> bool:
    """Whether no compass is in use, and one that speaks and varies contradicts the estimate and is worth more than it.

    One that was seen to turn there is as soon as it stays: a sea has knocked her round. One that is there of a
    sudden is where there is no other source: after its probation if it stays, after a minute in any case, for
    nothing has corrected the estimate for so long.
    """
    if state.in_use in (Source.COMPASS_A, Source.COMPASS_B):
        return False
    alone = state.in_use is Source.NONE
    for compass, timeout_s in zip(state.compasses, timeouts_s, strict=True):
        t_s, stay = compass.t_s, compass.stay
        if t_s is None or not compass.speaks(now_s, timeout_s) or t_s != compass.changed_s:
            continue
        if stay is not None and t_s - stay.since_s > (STAYED_S if stay.turned else PROBATION_S if alone else math.inf):
            return True
        if alone and t_s - compass.near_s > CONTRADICTED_S:
            return True
    return False


def _stay(state: CompassState, sample: TrueHeadingSample) -> Stay:
    """Return where it stays that shows a sample beyond the gate."""
    since_s = 0.0 if state.t_s is None else sample.t_s - state.t_s
    reach_rad = min(SPIN_RAD_S * since_s + SPIN_NOISE_RAD, JUMP_RAD)
    last_rad = None if state.raw_rad is None else state.heading_rad
    return stays(state.stay, sample.t_s, sample.heading_rad, reach_rad, last_rad, left=state.near_s == state.t_s)


def update_compass(state: CompassState, sample: TrueHeadingSample, expected_rad: float | None) -> CompassState:
    """Take in a sample; expected_rad is the estimated heading with its wave yaw, None before there is one."""
    changed = state.raw_rad is None or sample.raw_rad != state.raw_rad
    difference_rad = 0.0 if expected_rad is None else wrap_pi(sample.heading_rad - expected_rad)
    near = abs(wrap_pi(difference_rad + state.offset_rad)) <= JUMP_RAD
    if near or state.t_s is None:
        near_s = sample.t_s
    else:
        near_s = max(state.near_s, sample.t_s - FIRST_JUMP_S) if state.near_s == state.t_s else state.near_s
    stay = None if near else _stay(state, sample)
    # What it was off by before it was sound, as while it was frozen, is nothing that it starts with.
    sound_s = 0.0 if state.sound_since_s is None else sample.t_s - state.sound_since_s
    step_s = clamp(sample.t_s - state.t_s, 0.0, SMOOTHING_S) if state.t_s is not None else SMOOTHING_S
    part = 1.0 if sound_s <= step_s else step_s / min(sound_s, SMOOTHING_S)
    steady_rad = difference_rad
    if state.steady_rad is not None:
        steady_rad = wrap_pi(state.steady_rad + step_s / SMOOTHING_S * wrap_pi(difference_rad - state.steady_rad))
    judged = near and expected_rad is not None
    agreed = abs(wrap_pi(steady_rad + state.offset_rad)) <= DISAGREEMENT_RAD if judged else state.agreed
    longest_s = state.longest_s
    if changed and state.sound_since_s is not None:
        shown_s = sample.t_s - state.changed_s
        longest_s = max(shown_s, longest_s * math.exp(-shown_s / LONGEST_MEMORY_S))
    return CompassState(
        sample.t_s,
        sample.raw_rad,
        sample.t_s if changed else state.changed_s,
        near_s,
        state.sound_since_s,
        wrap_pi(state.difference_rad + part * wrap_pi(difference_rad - state.difference_rad)),
        state.offset_rad,
        longest_s,
        contradicted=state.contradicted and not changed,
        steady_rad=None if expected_rad is None else steady_rad,
        agreed=agreed,
        heading_rad=sample.heading_rad,
        stay=stay,
    )


def add_sample(state: SourceState, sample: TrueHeadingSample, expected_rad: float | None) -> SourceState:
    """Take a sample of either compass in."""
    a, b = state.compasses
    if sample.source == Source.COMPASS_B:
        return SourceState((a, update_compass(b, sample, expected_rad)), state.in_use)
    return SourceState((update_compass(a, sample, expected_rad), b), state.in_use)


def _judge(state: CompassState, now_s: float, settings: SourceSettings, timeout_s: float) -> CompassState:
    if not state.speaks(now_s, timeout_s):
        # It may come back with the same number, which has not stood meanwhile, unless it did before.
        raw_rad = state.raw_rad if state.stood(settings) else None
        if state.sound_since_s is None and raw_rad is state.raw_rad and state.steady_rad is None:
            return state
        return replace(state, sound_since_s=None, raw_rad=raw_rad, steady_rad=None)
    if state.frozen(now_s, settings, timeout_s):
        return replace(state, sound_since_s=None, steady_rad=None)
    if state.jumping():
        return replace(state, sound_since_s=None)
    return state if state.sound_since_s is not None else replace(state, sound_since_s=now_s)


def select(
    state: SourceState,
    now_s: float,
    settings: SourceSettings,
    timeouts_s: tuple[float, float],
    *,
    course_ok: bool,
) -> tuple[SourceState, tuple[Event, ...]]:
    """Judge the compasses, each of which is silent after its time-out, and choose the source; a change is an event."""
    (before_a, before_b), (a_timeout_s, b_timeout_s) = state.compasses, timeouts_s
    a = _judge(before_a, now_s, settings, a_timeout_s)
    b = _judge(before_b, now_s, settings, b_timeout_s)
    in_use = _first_sound_source(state.in_use, (a, b), now_s, course_ok=course_ok)
    if in_use is state.in_use:
        return state if a is before_a and b is before_b else SourceState((a, b), in_use), ()
    if in_use in (Source.COMPASS_A, Source.COMPASS_B) and state.in_use is not Source.NONE:
        # It starts where the estimate is, and is drawn to its own heading slowly.
        entering = (a, b)[in_use]
        entering = replace(entering, offset_rad=wrap_pi(-entering.difference_rad), near_s=now_s)
        a, b = (entering, b) if in_use is Source.COMPASS_A else (a, entering)
    return SourceState((a, b), in_use), (_change_event(state.in_use, in_use),)


def _first_sound_source(
    before: Source, compasses: tuple[CompassState, CompassState], now_s: float, *, course_ok: bool
) -> Source:
    for source, compass in zip((Source.COMPASS_A, Source.COMPASS_B), compasses, strict=True):
        since_s = compass.sound_since_s
        if since_s is None:
            continue
        # The source in use stays; before the first source nobody waits; another must prove itself unless it is needed.
        if source is before or before is Source.NONE or now_s - since_s >= PROBATION_S:
            return source
    return Source.COURSE if course_ok and before is not Source.NONE else Source.NONE


def _change_event(before: Source, after: Source) -> Event:
    if after is Source.NONE:
        return Event(Severity.ERROR, f"Heading lost: {NAMES[before]} fails")
    if before is Source.NONE:
        return Event(Severity.INFO, f"Heading from {NAMES[after]}")
    worse = after > before
    return Event(Severity.WARNING if worse else Severity.NOTICE, f"Heading from {NAMES[after]}, not {NAMES[before]}")


def samples_in_use(state: SourceState, samples: Sequence[TrueHeadingSample]) -> list[Heading]:
    """Return time and heading of the samples of the source in use, its offset added."""
    if state.in_use not in (Source.COMPASS_A, Source.COMPASS_B):
        return []
    offset_rad = state.compasses[state.in_use].offset_rad
    return [Heading(sample.t_s, sample.heading_rad + offset_rad) for sample in samples if sample.source == state.in_use]


def decay_offsets(state: SourceState, step_s: float) -> SourceState:
    """Draw the offsets toward zero."""
    a, b = state.compasses
    if a.offset_rad == 0.0 and b.offset_rad == 0.0:
        return state
    a, b = (_decay(compass, SLEW_RAD_S * step_s) for compass in state.compasses)
    return replace(state, compasses=(a, b))


def _decay(state: CompassState, reach_rad: float) -> CompassState:
    rest_rad = max(abs(state.offset_rad) - reach_rad, 0.0)
    return replace(state, offset_rad=math.copysign(rest_rad, state.offset_rad) if rest_rad else 0.0)
