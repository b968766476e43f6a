"""Choice of the heading source: compass A, compass B, or as a last resort the course over ground.

Each compass is checked by itself: it must send headings, these must follow the turns of the boat, and they must be
inside the gate around the estimate. A coarse or damped compass may send a constant reading while the heading is
constant. So a constant reading is a fault only if the boat has turned at the same time, according to rudder and waves
(heading_tick.py), the other compass or the track.

The first sound compass is in use. A change of source does not move the rudder: the new source starts with an offset
that makes it agree with the estimate, and the offset then decays. A compass is used again only after a probation.

Numeric core: functions without I/O that the laboratory compiles unchanged (hil/lab/numeric_core.py); NaN: absent.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, radians, wrap_pi

# Largest difference of a heading from the estimate with its wave yaw, in small waves.
JUMP_GATE_RAD: Final = radians(20.0)
JUMP_TIME_S: Final = 1.5  # outside the gate, after which a compass has jumped
INITIAL_JUMP_TIME_S: Final = 1.0  # most that the first heading outside can count, so that it alone is no jump
PROBATION_S: Final = 10.0  # in which a compass must be sound before it is used again
MAX_CONTRADICTION_S: Final = 60.0  # without a source, of a compass outside the gate; then the estimate restarts
OFFSET_SLEW_RAD_S: Final = radians(0.5)
DISAGREEMENT_RAD: Final = radians(15.0)
SMOOTHING_S: Final = 10.0  # time constant of the differences from the estimate
MIN_STANDSTILL_S: Final = 1.5  # with a constant reading
STANDSTILL_RATIO: Final = 2.0  # limit of the time with a constant reading, in multiples of the longest so far
LONGEST_MEMORY_S: Final = 600.0  # of the longest time with a constant reading
MIN_RESOLUTION_STEPS: Final = 2.5  # a smaller turn may not change the reading
MIN_SWINGS, SWINGS_MEMORY_S = 3.0, 20.0  # of a boat in waves; in calm water it overshoots once or twice after a turn
# Plateau: a compass has settled outside the gate, because a wave has turned the boat or the compass has jumped.
PLATEAU_TIME_S: Final = 2.0  # after which it has settled; a turn of the boat by a wave is over by then
PLATEAU_RAD: Final = radians(15.0)
MAX_YAW_RATE_RAD_S: Final = radians(90.0)  # of a boat that is turned by a breaking wave
MAX_YAW_NOISE_RAD: Final = radians(3.0)


class Source(IntEnum):
    """Source of the heading."""

    COMPASS_A = 0
    COMPASS_B = 1
    COURSE = 2
    NONE = 3


class TrueHeadingSample(NamedTuple):
    """True heading of compass A (source 0) or B (1), and the reading: the heading as the device sent it."""

    t_s: float
    heading_rad: float
    raw_rad: float
    source: int


class HeadingPlateau(NamedTuple):
    """Heading outside the gate at which a compass has settled, and since when (NaN: not settled).

    `turned`: the samples show the turn from the estimate to this heading, at a possible yaw rate.
    """

    around_rad: float = 0.0
    since_s: float = math.nan
    turned: bool = False


NO_PLATEAU: Final = HeadingPlateau()


def update_plateau(
    previous: HeadingPlateau,
    t_s: float,
    heading_rad: float,
    max_turn_rad: float,
    last_rad: float,
    was_inside: bool,  # noqa: FBT001 - compiled
) -> HeadingPlateau:
    """Return the plateau after a heading outside the gate.

    `last_rad` is the previous heading (NaN: none); `was_inside`: that was inside the gate. A heading that differs from
    it by more than max_turn_rad has jumped.
    """
    is_turn, was_settled = abs(wrap_pi(heading_rad - last_rad)) <= max_turn_rad, not math.isnan(previous.since_s)
    if was_settled and is_turn and not was_inside and abs(wrap_pi(heading_rad - previous.around_rad)) <= PLATEAU_RAD:
        return previous
    return HeadingPlateau(heading_rad, t_s, is_turn and (was_inside or (was_settled and previous.turned)))


class CompassTurns(NamedTuple):
    """Turns of the boat according to the reading of a compass.

    `resolution_rad`: smallest change of the reading so far. `apart_rad`: smoothed difference from the other compass
    when the reading last changed (NaN: no other compass). `swings`: number of recent reversals by a turn that the
    compass can resolve, with a fading memory. `farthest_rad`: largest reading in the direction `rising` (1, -1; 0:
    none).
    """

    resolution_rad: float = radians(5.0)  # assumed until the reading has changed
    apart_rad: float = math.nan
    swings: float = 0.0
    farthest_rad: float = math.nan
    rising: float = 0.0


NO_TURNS: Final = CompassTurns()


class CompassState(NamedTuple):
    """State of a compass; its last heading is `heading_rad` at `t_s`, sent by the device as `raw_rad`.

    `changed_s`: time of the last change of the reading. `near_s`: time of the last heading inside the gate around the
    estimate. `sound_since_s`: time since which the compass is sound (NaN: it is not). `difference_rad`: smoothed
    difference from the estimate. `offset_rad`: added to the heading after a change of source. `longest_s`: longest
    recent time with a constant reading. `contradicted`: the reading did not change although the boat must have turned.
    `steady_rad`: difference smoothed also outside the gate (NaN while the compass does not measure). `agreed`: it was
    small when the heading was last inside, so that a heading outside is a jump.
    """

    t_s: float = math.nan
    raw_rad: float = math.nan
    changed_s: float = 0.0
    near_s: float = 0.0
    sound_since_s: float = math.nan
    difference_rad: float = 0.0
    offset_rad: float = 0.0
    longest_s: float = 1.0
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
    """Return whether there is a heading that is not older than the time-out."""
    return now_s - compass.t_s <= timeout_s


def has_stopped_measuring(compass: CompassState, frozen_s: float) -> bool:
    """Return whether the reading was constant while the boat turned; never if frozen_s is 0."""
    return frozen_s != 0.0 and compass.contradicted


def has_stood_still(compass: CompassState, frozen_s: float) -> bool:
    """Return whether the reading has been constant for more than frozen_s; never if frozen_s is 0."""
    return frozen_s != 0.0 and compass.t_s - compass.changed_s > frozen_s


def min_contradiction(compass: CompassState, turn_rad: float) -> float:
    """Return the smallest turn that contradicts a constant reading: turn_rad, or a few resolution steps."""
    return max(turn_rad, MIN_RESOLUTION_STEPS * compass.turns.resolution_rad)


def is_frozen(compass: CompassState, now_s: float, frozen_s: float, timeout_s: float) -> bool:
    """Return whether a compass that sends headings has stopped measuring."""
    return is_received(compass, now_s, timeout_s) and has_stopped_measuring(compass, frozen_s)


def is_jumping(compass: CompassState) -> bool:
    """Return whether the headings have been outside the gate for longer than JUMP_TIME_S."""
    return compass.t_s - compass.near_s > JUMP_TIME_S


def standstill_ratio(compass: CompassState) -> float:
    """Return the duration of the present reading, divided by that from which on it is a standstill."""
    constant_s = 0.0 if math.isnan(compass.t_s) else compass.t_s - compass.changed_s
    return constant_s / max(MIN_STANDSTILL_S, STANDSTILL_RATIO * compass.longest_s)


def uses_compass(state: SourceState) -> bool:
    """Return whether a compass is in use."""
    return state.in_use == Source.COMPASS_A or state.in_use == Source.COMPASS_B  # noqa: PLR1714 - compiled


def compass_in_use(state: SourceState) -> CompassState:
    """Return the compass in use, or NO_COMPASS."""
    if state.in_use == Source.COMPASS_A:
        return state.compasses[0]
    return state.compasses[1] if state.in_use == Source.COMPASS_B else NO_COMPASS


NO_COMPASS: Final = CompassState()


def compasses_disagree(state: SourceState) -> bool:
    """Return whether two working compasses differ by more than DISAGREEMENT_RAD."""
    return abs(wrap_pi(state.compasses[0].steady_rad - state.compasses[1].steady_rad)) > DISAGREEMENT_RAD


def needs_restart(state: SourceState, now_s: float, timeouts_s: tuple[float, float]) -> bool:
    """Return whether no compass is in use and a compass contradicts the estimate; time-outs of compass A and B."""
    if uses_compass(state):
        return False
    has_no_source = state.in_use == Source.NONE
    return contradicts(state.compasses[0], now_s, timeouts_s[0], has_no_source) or contradicts(
        state.compasses[1], now_s, timeouts_s[1], has_no_source
    )


def contradicts(compass: CompassState, now_s: float, timeout_s: float, has_no_source: bool) -> bool:  # noqa: FBT001 - compiled
    """Return whether a compass whose reading changes contradicts the estimate.

    A compass that measured the turn contradicts it as soon as it has settled: a wave has turned the boat. One that
    jumped contradicts it only if there is no source: after PROBATION_S if it has settled, and in any case after
    MAX_CONTRADICTION_S, because the estimate has not been updated in that time.
    """
    if not is_received(compass, now_s, timeout_s) or compass.t_s != compass.changed_s:
        return False
    settled_s = compass.t_s - compass.plateau.since_s
    if settled_s > PLATEAU_TIME_S and (compass.plateau.turned or (has_no_source and settled_s > PROBATION_S)):
        return True
    return has_no_source and compass.t_s - compass.near_s > MAX_CONTRADICTION_S


def update_compass(
    compass: CompassState, sample: TrueHeadingSample, expected_rad: float, gate_rad: float = JUMP_GATE_RAD
) -> CompassState:
    """Return the compass after a sample.

    `expected_rad` is the estimated heading with its wave yaw (NaN: no estimate). A heading that differs by more than
    gate_rad has jumped.
    """
    is_first, has_estimate = math.isnan(compass.t_s), not math.isnan(expected_rad)
    interval_s = sample.t_s - compass.t_s
    has_changed = sample.raw_rad != compass.raw_rad
    difference_rad = wrap_pi(sample.heading_rad - expected_rad) if has_estimate else 0.0
    is_near = abs(wrap_pi(difference_rad + compass.offset_rad)) <= gate_rad
    near_s, plateau = compass.near_s, compass.plateau
    if is_near or is_first:
        near_s = sample.t_s
    elif compass.near_s == compass.t_s:
        near_s = max(compass.near_s, sample.t_s - INITIAL_JUMP_TIME_S)
    if is_near:
        plateau = NO_PLATEAU
    else:
        max_turn_rad = min(MAX_YAW_RATE_RAD_S * (0.0 if is_first else interval_s) + MAX_YAW_NOISE_RAD, JUMP_GATE_RAD)
        last_rad = math.nan if math.isnan(compass.raw_rad) else compass.heading_rad
        plateau = update_plateau(
            plateau, sample.t_s, sample.heading_rad, max_turn_rad, last_rad, compass.near_s == compass.t_s
        )
    # The mean begins when the compass becomes sound, so that it contains no differences of a frozen compass.
    sound_s = 0.0 if math.isnan(compass.sound_since_s) else sample.t_s - compass.sound_since_s
    step_s = SMOOTHING_S if is_first else clamp(interval_s, 0.0, SMOOTHING_S)
    gain = 1.0 if sound_s <= step_s else step_s / min(sound_s, SMOOTHING_S)
    steady_rad = difference_rad
    if not math.isnan(compass.steady_rad):
        steady_rad = wrap_pi(compass.steady_rad + step_s / SMOOTHING_S * wrap_pi(difference_rad - compass.steady_rad))
    agreed = compass.agreed
    if is_near and has_estimate:
        agreed = abs(wrap_pi(steady_rad + compass.offset_rad)) <= DISAGREEMENT_RAD
    longest_s = compass.longest_s
    if has_changed and not math.isnan(compass.sound_since_s):
        constant_s = sample.t_s - compass.changed_s
        longest_s = max(constant_s, longest_s * math.exp(-constant_s / LONGEST_MEMORY_S))
    return CompassState(
        sample.t_s,
        sample.raw_rad,
        sample.t_s if has_changed else compass.changed_s,
        near_s,
        compass.sound_since_s,
        wrap_pi(compass.difference_rad + gain * wrap_pi(difference_rad - compass.difference_rad)),
        compass.offset_rad,
        longest_s,
        compass.contradicted and not has_changed,
        steady_rad if has_estimate else math.nan,
        agreed,
        sample.heading_rad,
        plateau,
        update_turns(compass, sample),
    )


def update_turns(compass: CompassState, sample: TrueHeadingSample) -> CompassTurns:
    """Return the turns of the compass after a sample."""
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
    """Return the state with the compass in use marked as contradicted: its reading is constant in a turn."""
    a, b = state.compasses
    if state.in_use == Source.COMPASS_A:
        a = with_turns(a, a.turns, True)
    elif state.in_use == Source.COMPASS_B:
        b = with_turns(b, b.turns, True)
    return SourceState((a, b), state.in_use)


def with_turns(c: CompassState, turns: CompassTurns, contradicted: bool) -> CompassState:  # noqa: FBT001 - compiled
    """Return the compass with these turns and this mark."""
    return CompassState(
        c.t_s, c.raw_rad, c.changed_s, c.near_s, c.sound_since_s, c.difference_rad, c.offset_rad, c.longest_s,
        contradicted, c.steady_rad, c.agreed, c.heading_rad, c.plateau, turns,
    )  # fmt: skip


def compare_compasses(compass: CompassState, other: CompassState, frozen_s: float) -> CompassState:
    """Return the compass after a comparison with the other one.

    It is contradicted if its reading is constant in waves, or while the other one has turned without a jump.
    """
    t, apart_rad = compass.turns, wrap_pi(compass.steady_rad - other.steady_rad)
    has_stood = has_stood_still(compass, frozen_s)
    is_contradicted = compass.contradicted or (has_stood and t.swings >= MIN_SWINGS)
    if compass.t_s != compass.changed_s and not math.isnan(t.apart_rad):
        turned_rad, apart_rad = abs(wrap_pi(apart_rad - t.apart_rad)), t.apart_rad
        has_not_jumped = other.near_s == other.t_s or other.plateau.turned
        is_contradicted |= has_stood and has_not_jumped and turned_rad > min_contradiction(compass, DISAGREEMENT_RAD)
    turns = CompassTurns(t.resolution_rad, apart_rad, t.swings, t.farthest_rad, t.rising)
    return with_turns(compass, turns, is_contradicted)


def with_soundness(c: CompassState, sound_since_s: float, raw_rad: float, steady_rad: float) -> CompassState:
    """Return the compass with this time since which it is sound, this reading and this smoothed difference."""
    return CompassState(
        c.t_s, raw_rad, c.changed_s, c.near_s, sound_since_s, c.difference_rad, c.offset_rad, c.longest_s,
        c.contradicted, steady_rad, c.agreed, c.heading_rad, c.plateau, c.turns,
    )  # fmt: skip


def with_offset(c: CompassState, offset_rad: float, near_s: float) -> CompassState:
    """Return the compass with this offset, and this time of the last heading inside the gate."""
    return CompassState(
        c.t_s, c.raw_rad, c.changed_s, near_s, c.sound_since_s, c.difference_rad, offset_rad, c.longest_s,
        c.contradicted, c.steady_rad, c.agreed, c.heading_rad, c.plateau, c.turns,
    )  # fmt: skip


def judge_soundness(compass: CompassState, now_s: float, frozen_s: float, timeout_s: float) -> CompassState:
    """Return the compass with `sound_since_s` updated for a tick."""
    sound_since_s, raw_rad, steady_rad = compass.sound_since_s, compass.raw_rad, compass.steady_rad
    if not is_received(compass, now_s, timeout_s):
        sound_since_s = steady_rad = math.nan
        if not has_stopped_measuring(compass, frozen_s):
            raw_rad = math.nan  # the same reading after a gap is no standstill
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
    is_course_usable: bool,  # noqa: FBT001 - compiled
) -> SourceState:
    """Return the state with the compasses judged, each with its time-out, and the source chosen."""
    a, b = state.compasses
    a, b = compare_compasses(a, b, frozen_s), compare_compasses(b, a, frozen_s)
    a, b = judge_soundness(a, now_s, frozen_s, timeouts_s[0]), judge_soundness(b, now_s, frozen_s, timeouts_s[1])
    in_use = choose_source(state.in_use, a, b, now_s, is_course_usable)
    if in_use != state.in_use and state.in_use != Source.NONE:  # noqa: PLR1714 - compiled
        # The offset makes the new source agree with the estimate at first, and then decays.
        if in_use == Source.COMPASS_A:
            a = with_offset(a, wrap_pi(-a.difference_rad), now_s)
        elif in_use == Source.COMPASS_B:
            b = with_offset(b, wrap_pi(-b.difference_rad), now_s)
    return SourceState((a, b), in_use)


def choose_source(
    previous: Source,
    a: CompassState,
    b: CompassState,
    now_s: float,
    is_course_usable: bool,  # noqa: FBT001 - compiled
) -> Source:
    """Return the first usable source of compass A, compass B and course.

    A compass that is not in use has a probation before its use, unless no source is in use.
    """
    if is_usable(a, previous == Source.COMPASS_A or previous == Source.NONE, now_s):  # noqa: PLR1714 - compiled
        return Source.COMPASS_A
    if is_usable(b, previous == Source.COMPASS_B or previous == Source.NONE, now_s):  # noqa: PLR1714 - compiled
        return Source.COMPASS_B
    return Source.COURSE if is_course_usable and previous != Source.NONE else Source.NONE


def is_usable(compass: CompassState, without_probation: bool, now_s: float) -> bool:  # noqa: FBT001 - compiled
    """Return whether the compass is sound, and has been sound for PROBATION_S unless it is used at once."""
    if math.isnan(compass.sound_since_s):
        return False
    return without_probation or now_s - compass.sound_since_s >= PROBATION_S


def decay_offsets(state: SourceState, step_s: float) -> SourceState:
    """Return the state with both offsets reduced over a step."""
    a, b = state.compasses
    if a.offset_rad == 0.0 and b.offset_rad == 0.0:
        return state
    return SourceState(
        (decay_offset(a, OFFSET_SLEW_RAD_S * step_s), decay_offset(b, OFFSET_SLEW_RAD_S * step_s)), state.in_use
    )


def decay_offset(compass: CompassState, step_rad: float) -> CompassState:
    """Return the compass with its offset reduced by at most step_rad."""
    size_rad = max(abs(compass.offset_rad) - step_rad, 0.0)
    offset_rad = math.copysign(size_rad, compass.offset_rad) if size_rad != 0.0 else 0.0
    return with_offset(compass, offset_rad, compass.near_s)
