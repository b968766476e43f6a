"""Choice of the heading source: compass A, compass B, or as a last resort the course over ground.

Each compass is judged by itself: it has to send headings, they have to follow the boat's turns, and they have to stay
inside the gate around the estimate. A coarse or damped compass may show one number for as long as the boat holds its
heading. So a constant number is a fault only if the boat has turned meanwhile, as shown by rudder and waves
(heading_tick.py), the other compass or the track.

The first sound compass is in use. A change of source does not move the rudder: the new source starts with the offset at
which it agrees with the estimate, and the offset then decays. A compass is used again only after it has been sound and
in agreement for a while.

Numeric core: functions without I/O that the laboratory compiles unchanged (hil/lab/numeric_core.py); NaN: absent.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, radians, wrap_pi

JUMP_GATE_RAD: Final = radians(
    20.0
)  # largest difference of a heading from the estimate with its wave yaw, in small waves
JUMP_TIME_S: Final = 1.5
INITIAL_JUMP_TIME_S: Final = 1.0  # credited to the first heading outside: one alone is no jump, even of a slow compass
PROBATION_S: Final = 10.0
MAX_CONTRADICTION_S: Final = 60.0
OFFSET_SLEW_RAD_S: Final = radians(0.5)
DISAGREEMENT_RAD: Final = radians(15.0)
SMOOTHING_S: Final = 10.0
MIN_STANDSTILL_S: Final = 1.5
STANDSTILL_RATIO: Final = 2.0  # by the longest time with one number so far: beyond it the compass stands still
INITIAL_LONGEST_S: Final = 1.0
LONGEST_MEMORY_S: Final = 600.0
MAX_RESOLUTION_RAD: Final = radians(5.0)  # assumed until the number has changed
MIN_RESOLUTION_STEPS: Final = 2.5  # a smaller turn need not show in the number
MIN_SWINGS, SWINGS_MEMORY_S = 3.0, 20.0  # of a boat in waves; one in flat water overshoots once or twice after a turn
# A compass that settles outside the gate: a sea has turned the boat, or the compass has jumped.
PLATEAU_TIME_S: Final = 2.0  # after which it has settled; a boat does not turn without end
PLATEAU_RAD: Final = radians(15.0)
MAX_YAW_RATE_RAD_S: Final = radians(90.0)  # of a boat that a breaking sea turns
MAX_YAW_NOISE_RAD: Final = radians(3.0)


class Source(IntEnum):
    """Source of the heading."""

    COMPASS_A = 0
    COMPASS_B = 1
    COURSE = 2
    NONE = 3


class TrueHeadingSample(NamedTuple):
    """A heading from true north of compass A (0) or B (1), with the number that the device gave."""

    t_s: float
    heading_rad: float
    raw_rad: float
    source: int


class HeadingPlateau(NamedTuple):
    """Heading outside the gate at which a compass has settled, its begin (NaN: not settled), and how it got there.

    `turned`: the samples show the turn from the estimate to there, at a rate that a boat can have.
    """

    around_rad: float = 0.0
    since_s: float = math.nan
    turned: bool = False


NO_PLATEAU: Final = HeadingPlateau()


def plateau_after(
    before: HeadingPlateau,
    t_s: float,
    heading_rad: float,
    reach_rad: float,
    last_rad: float,
    left: bool,  # noqa: FBT001 - compiled
) -> HeadingPlateau:
    """Return the plateau after a heading outside of the gate.

    `last_rad` is the heading before (NaN: none), `left`: that one was inside. A heading that differs from it by more
    than reach_rad has jumped.
    """
    turns, stayed = abs(wrap_pi(heading_rad - last_rad)) <= reach_rad, not math.isnan(before.since_s)
    if stayed and turns and not left and abs(wrap_pi(heading_rad - before.around_rad)) <= PLATEAU_RAD:
        return before
    return HeadingPlateau(heading_rad, t_s, turns and (left or (stayed and before.turned)))


class CompassTurns(NamedTuple):
    """Turns shown by the number of a compass.

    `resolution_rad` is its smallest change so far, `apart_rad` the smoothed difference from the other compass when it
    last changed (NaN: there was no other). `swings` is how often it recently swung back by a turn that the compass has
    to show, `farthest_rad` the number farthest in the direction `rising` (1, -1; 0: none).
    """

    resolution_rad: float = MAX_RESOLUTION_RAD
    apart_rad: float = math.nan
    swings: float = 0.0
    farthest_rad: float = math.nan
    rising: float = 0.0


NO_TURNS: Final = CompassTurns()


class CompassState(NamedTuple):
    """State of a compass; its last heading is `heading_rad` at `t_s`, as a number of the device `raw_rad`.

    `changed_s` is when the number last changed, `near_s` when the heading was last inside the gate around the estimate,
    `sound_since_s` since when the compass is sound. `difference_rad` is the smoothed difference from the estimate,
    `offset_rad` is added to the heading after a change of source. `longest_s` is the longest recent time with one
    number; `contradicted`: the number did not change although the boat must have turned. `steady_rad` is the difference
    smoothed also outside of the gate (NaN while the compass does not measure); `agreed`: it was small when the heading
    was last inside, so that a heading outside is a jump. `plateau`: where the compass has settled outside the gate.
    """

    t_s: float = math.nan
    raw_rad: float = math.nan
    changed_s: float = 0.0
    near_s: float = 0.0
    sound_since_s: float = math.nan
    difference_rad: float = 0.0
    offset_rad: float = 0.0
    longest_s: float = INITIAL_LONGEST_S
    contradicted: bool = False
    steady_rad: float = math.nan
    agreed: bool = False
    heading_rad: float = 0.0
    plateau: HeadingPlateau = NO_PLATEAU
    turns: CompassTurns = NO_TURNS


class SourceState(NamedTuple):
    """The compasses and the source in use."""

    compasses: tuple[CompassState, CompassState] = (CompassState(), CompassState())
    in_use: Source = Source.NONE


START: Final = SourceState()


def is_received(compass: CompassState, now_s: float, timeout_s: float) -> bool:
    """Return whether the last heading is not older than the time-out."""
    return now_s - compass.t_s <= timeout_s


def has_stopped_measuring(compass: CompassState, frozen_s: float) -> bool:
    """Return whether the number had not changed while the boat turned, at the last heading; frozen_s 0: disabled."""
    return frozen_s != 0.0 and compass.contradicted


def has_stood_still(compass: CompassState, frozen_s: float) -> bool:
    """Return whether the number has not changed for more than frozen_s; 0: disabled."""
    return frozen_s != 0.0 and compass.t_s - compass.changed_s > frozen_s


def min_contradiction(compass: CompassState, turn_rad: float) -> float:
    """Return the smallest turn that contradicts a number that does not change: turn_rad, or a few resolution steps."""
    return max(turn_rad, MIN_RESOLUTION_STEPS * compass.turns.resolution_rad)


def is_frozen(compass: CompassState, now_s: float, frozen_s: float, timeout_s: float) -> bool:
    """Return whether a compass that sends headings has stopped measuring."""
    return is_received(compass, now_s, timeout_s) and has_stopped_measuring(compass, frozen_s)


def is_jumping(compass: CompassState) -> bool:
    """Return whether the compass shows headings that the boat cannot have turned to."""
    return compass.t_s - compass.near_s > JUMP_TIME_S


def standstill_ratio(compass: CompassState) -> float:
    """Return the time with the present number by the time after which the compass stands still."""
    shown_s = 0.0 if math.isnan(compass.t_s) else compass.t_s - compass.changed_s
    return shown_s / max(MIN_STANDSTILL_S, STANDSTILL_RATIO * compass.longest_s)


def uses_compass(state: SourceState) -> bool:
    """Return whether a compass is in use."""
    return state.in_use == Source.COMPASS_A or state.in_use == Source.COMPASS_B  # noqa: PLR1714 - compiled


def compass_in_use(state: SourceState) -> CompassState:
    """Return the compass in use; one without headings if there is none."""
    if state.in_use == Source.COMPASS_A:
        return state.compasses[0]
    return state.compasses[1] if state.in_use == Source.COMPASS_B else NO_COMPASS


NO_COMPASS: Final = CompassState()


def compasses_disagree(state: SourceState) -> bool:
    """Return whether two working compasses differ by more than DISAGREEMENT_RAD."""
    return abs(wrap_pi(state.compasses[0].steady_rad - state.compasses[1].steady_rad)) > DISAGREEMENT_RAD


def needs_restart(state: SourceState, now_s: float, timeouts_s: tuple[float, float]) -> bool:
    """Return whether no compass is in use, and one contradicts the estimate with more evidence.

    The time-outs are those of the compasses.
    """
    if uses_compass(state):
        return False
    alone = state.in_use == Source.NONE
    return contradicts(state.compasses[0], now_s, timeouts_s[0], alone) or contradicts(
        state.compasses[1], now_s, timeouts_s[1], alone
    )


def contradicts(compass: CompassState, now_s: float, timeout_s: float, alone: bool) -> bool:  # noqa: FBT001 - compiled
    """Return whether a compass that varies contradicts the estimate; `alone`: there is no other source.

    One that showed the turn does so as soon as it has settled: a sea has turned the boat. One that jumped does so only
    without another source: after its probation if it has settled, and after a minute in any case, because nothing has
    corrected the estimate for that time.
    """
    if not is_received(compass, now_s, timeout_s) or compass.t_s != compass.changed_s:
        return False
    stayed_s = compass.t_s - compass.plateau.since_s
    if stayed_s > PLATEAU_TIME_S and (compass.plateau.turned or (alone and stayed_s > PROBATION_S)):
        return True
    return alone and compass.t_s - compass.near_s > MAX_CONTRADICTION_S


def update_compass(
    compass: CompassState, sample: TrueHeadingSample, expected_rad: float, gate_rad: float = JUMP_GATE_RAD
) -> CompassState:
    """Return a compass after a sample.

    expected_rad is the estimated heading with its wave yaw (NaN: none yet). A heading that differs by more than
    gate_rad has jumped.
    """
    first, expected = math.isnan(compass.t_s), not math.isnan(expected_rad)
    since_s = sample.t_s - compass.t_s
    changed = sample.raw_rad != compass.raw_rad
    difference_rad = wrap_pi(sample.heading_rad - expected_rad) if expected else 0.0
    near = abs(wrap_pi(difference_rad + compass.offset_rad)) <= gate_rad
    near_s, plateau = compass.near_s, compass.plateau
    if near or first:
        near_s = sample.t_s
    elif compass.near_s == compass.t_s:
        near_s = max(compass.near_s, sample.t_s - INITIAL_JUMP_TIME_S)
    if near:
        plateau = NO_PLATEAU
    else:
        reach_rad = min(MAX_YAW_RATE_RAD_S * (0.0 if first else since_s) + MAX_YAW_NOISE_RAD, JUMP_GATE_RAD)
        last_rad = math.nan if math.isnan(compass.raw_rad) else compass.heading_rad
        plateau = plateau_after(
            plateau, sample.t_s, sample.heading_rad, reach_rad, last_rad, compass.near_s == compass.t_s
        )
    # Differences before the compass was sound, as while it was frozen, do not count.
    sound_s = 0.0 if math.isnan(compass.sound_since_s) else sample.t_s - compass.sound_since_s
    step_s = SMOOTHING_S if first else clamp(since_s, 0.0, SMOOTHING_S)
    part = 1.0 if sound_s <= step_s else step_s / min(sound_s, SMOOTHING_S)
    steady_rad = difference_rad
    if not math.isnan(compass.steady_rad):
        steady_rad = wrap_pi(compass.steady_rad + step_s / SMOOTHING_S * wrap_pi(difference_rad - compass.steady_rad))
    agreed = compass.agreed
    if near and expected:
        agreed = abs(wrap_pi(steady_rad + compass.offset_rad)) <= DISAGREEMENT_RAD
    longest_s = compass.longest_s
    if changed and not math.isnan(compass.sound_since_s):
        shown_s = sample.t_s - compass.changed_s
        longest_s = max(shown_s, longest_s * math.exp(-shown_s / LONGEST_MEMORY_S))
    return CompassState(
        sample.t_s,
        sample.raw_rad,
        sample.t_s if changed else compass.changed_s,
        near_s,
        compass.sound_since_s,
        wrap_pi(compass.difference_rad + part * wrap_pi(difference_rad - compass.difference_rad)),
        compass.offset_rad,
        longest_s,
        compass.contradicted and not changed,
        steady_rad if expected else math.nan,
        agreed,
        sample.heading_rad,
        plateau,
        turns_after(compass, sample),
    )


def turns_after(compass: CompassState, sample: TrueHeadingSample) -> CompassTurns:
    """Return the turns of a compass after a sample."""
    t, raw_rad = compass.turns, sample.raw_rad
    if math.isnan(compass.raw_rad):
        return CompassTurns(t.resolution_rad, t.apart_rad, 0.0, raw_rad, 0.0)
    if raw_rad == compass.raw_rad:
        return t
    resolution_rad = min(t.resolution_rad, abs(wrap_pi(raw_rad - compass.raw_rad)))
    swings = t.swings * math.exp((compass.changed_s - sample.t_s) / SWINGS_MEMORY_S)
    turned_rad = wrap_pi(raw_rad - t.farthest_rad)
    if t.rising == 0.0 or turned_rad * t.rising > 0.0:
        return CompassTurns(resolution_rad, t.apart_rad, swings, raw_rad, math.copysign(1.0, turned_rad))
    if abs(turned_rad) < min_contradiction(compass, 0.0):
        return CompassTurns(resolution_rad, t.apart_rad, swings, t.farthest_rad, t.rising)
    return CompassTurns(resolution_rad, t.apart_rad, swings + 1.0, raw_rad, -t.rising)


def add_sample(
    state: SourceState, sample: TrueHeadingSample, expected_rad: float, gate_rad: float = JUMP_GATE_RAD
) -> SourceState:
    """Return the state after a sample of either compass."""
    a, b = state.compasses
    if sample.source == 1:
        return SourceState((a, update_compass(b, sample, expected_rad, gate_rad)), state.in_use)
    return SourceState((update_compass(a, sample, expected_rad, gate_rad), b), state.in_use)


def mark_contradicted(state: SourceState) -> SourceState:
    """Return the state with the compass in use contradicted: it repeats its number although the boat has turned."""
    a, b = state.compasses
    if state.in_use == Source.COMPASS_A:
        a = with_turns(a, a.turns, True)
    elif state.in_use == Source.COMPASS_B:
        b = with_turns(b, b.turns, True)
    return SourceState((a, b), state.in_use)


def with_turns(c: CompassState, turns: CompassTurns, contradicted: bool) -> CompassState:  # noqa: FBT001 - compiled
    """Return a compass with other turns, contradicted or not."""
    return CompassState(
        c.t_s, c.raw_rad, c.changed_s, c.near_s, c.sound_since_s, c.difference_rad, c.offset_rad, c.longest_s,
        contradicted, c.steady_rad, c.agreed, c.heading_rad, c.plateau, turns,
    )  # fmt: skip


def compare_with_other(compass: CompassState, other: CompassState, frozen_s: float) -> CompassState:
    """Return a compass compared with the other; contradicted if it stands still in waves, or while the other turned.

    The other one has to measure, and must not have jumped.
    """
    t, apart_rad = compass.turns, wrap_pi(compass.steady_rad - other.steady_rad)
    stood = has_stood_still(compass, frozen_s)
    contradicted = compass.contradicted or (stood and t.swings >= MIN_SWINGS)
    if compass.t_s != compass.changed_s and not math.isnan(t.apart_rad):
        turned_rad, apart_rad = abs(wrap_pi(apart_rad - t.apart_rad)), t.apart_rad
        follows = other.near_s == other.t_s or other.plateau.turned
        contradicted |= stood and follows and turned_rad > min_contradiction(compass, DISAGREEMENT_RAD)
    turns = CompassTurns(t.resolution_rad, apart_rad, t.swings, t.farthest_rad, t.rising)
    return with_turns(compass, turns, contradicted)


def with_soundness(c: CompassState, sound_since_s: float, raw_rad: float, steady_rad: float) -> CompassState:
    """Return a compass with the time since which it is sound, its number and its steady difference."""
    return CompassState(
        c.t_s, raw_rad, c.changed_s, c.near_s, sound_since_s, c.difference_rad, c.offset_rad, c.longest_s,
        c.contradicted, steady_rad, c.agreed, c.heading_rad, c.plateau, c.turns,
    )  # fmt: skip


def with_offset(c: CompassState, offset_rad: float, near_s: float) -> CompassState:
    """Return a compass with an offset, and the time when its heading was last inside the gate."""
    return CompassState(
        c.t_s, c.raw_rad, c.changed_s, near_s, c.sound_since_s, c.difference_rad, offset_rad, c.longest_s,
        c.contradicted, c.steady_rad, c.agreed, c.heading_rad, c.plateau, c.turns,
    )  # fmt: skip


def judge_soundness(compass: CompassState, now_s: float, frozen_s: float, timeout_s: float) -> CompassState:
    """Return a compass with `sound_since_s` for a tick."""
    sound_since_s, raw_rad, steady_rad = compass.sound_since_s, compass.raw_rad, compass.steady_rad
    if not is_received(compass, now_s, timeout_s):
        sound_since_s = steady_rad = math.nan
        if not has_stopped_measuring(compass, frozen_s):
            raw_rad = math.nan  # the same number after a silence is no standstill
    elif has_stopped_measuring(compass, frozen_s):
        sound_since_s = steady_rad = math.nan
    elif is_jumping(compass):
        sound_since_s = math.nan
    elif math.isnan(sound_since_s):
        sound_since_s = now_s
    return with_soundness(compass, sound_since_s, raw_rad, steady_rad)


def select(
    state: SourceState,
    now_s: float,
    frozen_s: float,
    timeouts_s: tuple[float, float],
    course_ok: bool,  # noqa: FBT001 - compiled
) -> SourceState:
    """Judge the compasses, each with its time-out, and choose the source; `course_ok`: the course can be used."""
    a, b = state.compasses
    a, b = compare_with_other(a, b, frozen_s), compare_with_other(b, a, frozen_s)
    a, b = judge_soundness(a, now_s, frozen_s, timeouts_s[0]), judge_soundness(b, now_s, frozen_s, timeouts_s[1])
    in_use = first_sound_source(state.in_use, a, b, now_s, course_ok)
    if in_use != state.in_use and state.in_use != Source.NONE:  # noqa: PLR1714 - compiled
        # The offset makes it agree with the estimate at first, and then decays.
        if in_use == Source.COMPASS_A:
            a = with_offset(a, wrap_pi(-a.difference_rad), now_s)
        elif in_use == Source.COMPASS_B:
            b = with_offset(b, wrap_pi(-b.difference_rad), now_s)
    return SourceState((a, b), in_use)


def first_sound_source(
    before: Source,
    a: CompassState,
    b: CompassState,
    now_s: float,
    course_ok: bool,  # noqa: FBT001 - compiled
) -> Source:
    """Return the source to use.

    The one in use stays while it is sound. The first one is used at once; another has its probation unless it is
    needed.
    """
    if is_usable(a, before == Source.COMPASS_A or before == Source.NONE, now_s):  # noqa: PLR1714 - compiled
        return Source.COMPASS_A
    if is_usable(b, before == Source.COMPASS_B or before == Source.NONE, now_s):  # noqa: PLR1714 - compiled
        return Source.COMPASS_B
    return Source.COURSE if course_ok and before != Source.NONE else Source.NONE


def is_usable(compass: CompassState, at_once: bool, now_s: float) -> bool:  # noqa: FBT001 - compiled
    """Return whether a compass is sound, and for the time of its probation unless it is used at once."""
    if math.isnan(compass.sound_since_s):
        return False
    return at_once or now_s - compass.sound_since_s >= PROBATION_S


def decay_offsets(state: SourceState, step_s: float) -> SourceState:
    """Return the state with the offsets nearer to zero after a step."""
    a, b = state.compasses
    if a.offset_rad == 0.0 and b.offset_rad == 0.0:
        return state
    return SourceState(
        (decay_offset(a, OFFSET_SLEW_RAD_S * step_s), decay_offset(b, OFFSET_SLEW_RAD_S * step_s)), state.in_use
    )


def decay_offset(compass: CompassState, reach_rad: float) -> CompassState:
    """Return a compass with an offset that is nearer to zero by reach_rad."""
    rest_rad = max(abs(compass.offset_rad) - reach_rad, 0.0)
    offset_rad = math.copysign(rest_rad, compass.offset_rad) if rest_rad != 0.0 else 0.0
    return with_offset(compass, offset_rad, compass.near_s)
