"""The autopilot in a tick: goals, sources, estimate, the watch over the helm, and the helm."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.lanes import COUNT
from hil.lab.tune.twins import clamp, limited_command, wrap_pi, wrap_two_pi
from hil.lab.twin import helm, kalman, oscillation, over_ground, sources, wave_filter
from hil.lab.twin.afloat import FEEDBACK_RAD, FIRST_FIX_S, FIXES, GIVEN, HEADINGS, Afloat, drop
from hil.lab.twin.devices import LOST, SAID_RAD, THERE_S
from hil.lab.twin.kalman import Covariances, Floats
from hil.lab.twin.learning import LOG_OMEGA
from hil.lab.twin.wave_filter_state import (
    FIX_T,
    OMEGA,
    RUDDER,
    SAMPLE_T,
    STARTED,
    Filters,
    WaveFilter,
    begin_anew,
    begin_filter,
    exp_of,
)

EPOCH_ENDS_AFTER_S = 0.5
ARMED_S, GUARD_S = 0.28, 0.003  # when the operator has armed and set the mode; before a tick the link waits
LOCK_MARGIN_S, LOCK_SLEW, LOCK_GAIN = 0.002, 0.005, 0.1
PERIOD_S = 1.0 / 10.0
WIDEST_COURSE_RAD = radians(20.0)

# Of Pilot.own, where NaN is what there is not yet.
(BEFORE_S, OWN_COMMAND_RAD, OWN_HEADING_RAD, OWN_RATE_RAD_S, STEERED_S, SAMPLE_S, GOAL_RAD, GOALS, NEWEST_S,
 OWN_ERROR_RAD, ARMED, THERE, USED, FIXED, HEADING_NEXT, FIX_NEXT) = range(16)  # fmt: skip
OWN = 16
NO_SAMPLE, HEADING, FIX = range(3)


class Boat(NamedTuple):
    """What the autopilot is told by its parameters; `model` is K, T, alpha and the speed that they are of."""

    model: Any  # four numbers: in a record, an array
    limit_rad: float
    trim_rad: float
    slew_rad_s: float
    deadband_rad: float
    compass_timeout_s: float
    position_timeout_s: float
    frozen_s: float
    course_speed_m_s: float
    cruise_speed_m_s: float
    servo_sign: float


class Task(NamedTuple):
    """When goals are given and their headings, as the operator's message rounds them."""

    given_s: Floats
    goals_rad: Floats


# What the autopilot remembers beside the wave filter.
PILOT = np.dtype(
    [
        ("helm", np.float64, (helm.HELM_STATES,)),
        ("known", np.float64, (helm.KNOWN,)),
        ("swing", np.float64, (oscillation.WATCH_STATES,)),
        ("source", np.float64, (sources.SOURCE_STATES,)),
        ("own", np.float64, (OWN,)),
    ]
)
Pilot = Any  # a record of PILOT


class Crew(NamedTuple):
    """The autopilots of a batch: records of all lanes, and what their filters work with side by side.

    `samples` is the heading, and `fixes` the fix, that each takes in next.
    """

    boats: NDArray[Any]
    pilots: NDArray[Any]
    filters: Filters
    covariances: NDArray[Any]
    samples: Floats
    fixes: Floats


@compiled
def begin_pilot(pilot: Pilot, f: WaveFilter, boat: Boat) -> None:
    """Be the autopilot before its first tick."""
    begin_filter(f, boat.cruise_speed_m_s)
    oscillation.begin_watch(pilot.swing)
    sources.begin(pilot.source)
    pilot.helm[helm.REF_HEADING] = pilot.helm[helm.FOLLOWED_BIAS] = np.nan
    e = pilot.known
    for i in range(4):
        e[helm.M_K + i] = boat.model[i]
    e[helm.LIMIT], e[helm.TRIM] = boat.limit_rad, boat.trim_rad
    pilot.own[BEFORE_S] = pilot.own[SAMPLE_S] = pilot.own[GOAL_RAD] = np.nan


@compiled
def take_goals(own: Floats, given_s: Floats, goals_rad: Floats, now_s: float) -> bool:
    """Take the goals that have come by the tick; return whether the boat is armed and GUIDED by then."""
    armed = now_s > ARMED_S + GUARD_S
    number = int(own[GOALS])
    while armed and number < given_s.size:
        if not (given_s[number] <= ARMED_S or given_s[number] < now_s - GUARD_S):
            break
        own[GOAL_RAD] = wrap_two_pi(goals_rad[number])
        number += 1
    own[GOALS] = number
    if armed and math.isnan(own[GOAL_RAD]):
        own[GOAL_RAD] = own[OWN_HEADING_RAD]
    return armed


@compiled
def judge_source(pilot: Pilot, f: WaveFilter, c: Covariances, boat: Boat, at: Afloat, now_s: float) -> int:
    """Judge the samples that are there and choose the source; return how many headings there are."""
    s, own, headings = pilot.source, pilot.own, at.headings
    lost_after_s = sources.timeout_s(s[sources.INTERVAL], boat.compass_timeout_s)
    fix_lost_after_s = sources.timeout_s(s[sources.FIX_INTERVAL], boat.position_timeout_s)
    if sources.contradicts(s, now_s, lost_after_s):
        begin_anew(f)
        sources.begin_anew(s)
    sources.decay_offset(s, clamp(now_s - own[STEERED_S], 0.0, 1.0))
    begun = f.w[STARTED] > 0.0
    expected_rad = f.x[kalman.FLOAT] + f.x[kalman.WAVE] if begun else np.nan
    count = 0
    own[NEWEST_S] = np.nan
    while count < at.counts[HEADINGS] and headings[count, THERE_S] <= now_s:
        t_s, said_rad = headings[count, THERE_S], headings[count, SAID_RAD]
        sources.add_sample(s, t_s, said_rad, said_rad, expected_rad)
        sources.learn_interval(s, sources.TOLD, sources.INTERVAL, t_s, boat.compass_timeout_s)
        own[NEWEST_S] = t_s
        count += 1
    course_ok = (
        begun
        and now_s - f.w[FIX_T] <= fix_lost_after_s
        and math.sqrt(c.p[kalman.HEADING, kalman.HEADING, f.lane]) <= WIDEST_COURSE_RAD
        and f.x[kalman.SPEED] >= boat.course_speed_m_s
    )
    sources.select(s, now_s, lost_after_s, boat.frozen_s, course_ok)
    return count


@compiled
def count_fixes(at: Afloat, now_s: float) -> int:
    """Return how many fixes are there; the first epoch is given when nothing has followed it for a while."""
    counts, count = at.counts, 0
    while count < counts[FIXES] and at.fixes[count, THERE_S] <= now_s:
        if counts[GIVEN] == 0:
            if not now_s - at.clock[FIRST_FIX_S] > EPOCH_ENDS_AFTER_S:
                break
            counts[GIVEN] = 1
        count += 1
    return count


@compiled
def look(pilot: Pilot, f: WaveFilter, c: Covariances, boat: Boat, at: Afloat, now_s: float) -> bool:
    """Look at what is there at a tick, and choose the source; return whether there is a fix."""
    own = pilot.own
    own[THERE] = judge_source(pilot, f, c, boat, at, now_s)
    own[USED] = own[THERE] if pilot.source[sources.IN_USE] == sources.COMPASS else 0.0
    own[FIXED] = count_fixes(at, now_s)
    own[HEADING_NEXT] = own[FIX_NEXT] = 0.0
    return bool(own[FIXED] > 0.0)


@compiled
def next_kind(own: Floats, at: Afloat) -> int:
    """Return of what kind the next sample is that a tick takes in, in order of their times, a heading first."""
    while True:
        heading, fix = int(own[HEADING_NEXT]), int(own[FIX_NEXT])
        no_fix = fix >= own[FIXED]
        if heading < own[USED] and (no_fix or at.headings[heading, THERE_S] <= at.fixes[fix, THERE_S]):
            return HEADING
        if no_fix:
            return NO_SAMPLE
        if at.fixes[fix, LOST] == 0.0:
            return FIX
        own[FIX_NEXT] += 1


@compiled
def hand_over(crew: Crew, at: Afloat, k: int, kind: int) -> None:
    """Hand a lane's next sample, of a kind, to its filter."""
    own, c = crew.pilots[k].own, crew.covariances[0]
    if kind == HEADING:
        number = int(own[HEADING_NEXT])
        c.to_s[k], said_rad = at.headings[number, THERE_S], at.headings[number, SAID_RAD]
        crew.samples[k] = said_rad + crew.pilots[k].source[sources.OFFSET]
        own[HEADING_NEXT] += 1.0
    else:
        for i in range(crew.fixes.shape[1]):
            crew.fixes[k, i] = at.fixes[int(own[FIX_NEXT]), i]
        own[FIX_NEXT] += 1.0


@compiled
def estimate(crew: Crew, afloat: NDArray[Any], going: int) -> None:
    """Take a tick's samples in, in the lanes in `going`; kind by kind, so that most lanes take part at once."""
    c = crew.covariances[0]
    while True:
        fixes = headings = 0
        for k in range(COUNT):
            if going >> k & 1 > 0:
                kind = next_kind(crew.pilots[k].own, afloat[k])
                fixes |= int(kind == FIX) << k
                headings |= int(kind == HEADING) << k
                if kind != NO_SAMPLE:
                    hand_over(crew, afloat[k], k, kind)
        if fixes | headings == 0:
            return
        if fixes > 0:
            kalman.turn_on(c, fixes)
            over_ground.correct_velocities(crew.filters, c, crew.boats, crew.fixes)
        if headings > 0:
            kalman.turn_on(c, headings)
            wave_filter.correct_headings(crew.filters, c, crew.boats, crew.samples)


@compiled
def settle(pilot: Pilot, f: WaveFilter, boat: Boat, at: Afloat, now_s: float) -> None:
    """Forget the samples of a tick, and carry the heading on to it."""
    s, own, there, fix_count = pilot.source, pilot.own, int(pilot.own[THERE]), int(pilot.own[FIXED])
    for k in range(fix_count):
        sources.learn_interval(s, sources.FIX_TOLD, sources.FIX_INTERVAL, at.fixes[k, THERE_S], boat.position_timeout_s)
    drop(at.headings, there, at.counts[HEADINGS])
    drop(at.fixes, fix_count, at.counts[FIXES])
    at.counts[HEADINGS] -= there
    at.counts[FIXES] -= fix_count
    f.w[RUDDER] = boat.servo_sign * at.clock[FEEDBACK_RAD]
    if f.w[STARTED] > 0.0:
        own[OWN_HEADING_RAD], own[OWN_RATE_RAD_S] = wave_filter.predict_heading(f, boat.model, now_s)
        if s[sources.IN_USE] == sources.COURSE:
            own[SAMPLE_S] = now_s
        elif not own[SAMPLE_S] > f.w[SAMPLE_T]:
            own[SAMPLE_S] = f.w[SAMPLE_T]
        own[STEERED_S] = now_s


@compiled
def steer(pilot: Pilot, f: WaveFilter, c: Covariances, boat: Boat, law: Floats, now_s: float, step_s: float) -> None:
    """Watch over the helm and steer: the next rudder command."""
    own, e, p, lane = pilot.own, pilot.known, c.p, f.lane
    begun, armed = f.w[STARTED] > 0.0, own[ARMED] > 0.0
    lost_after_s = sources.timeout_s(pilot.source[sources.INTERVAL], boat.compass_timeout_s)
    steered = armed and now_s - own[SAMPLE_S] <= lost_after_s and not math.isnan(own[GOAL_RAD])
    own[OWN_ERROR_RAD] = error_rad = wrap_pi(own[GOAL_RAD] - own[OWN_HEADING_RAD]) if steered else np.nan
    if begun:
        e[helm.E_HEADING], e[helm.E_RATE] = own[OWN_HEADING_RAD], own[OWN_RATE_RAD_S]
        e[helm.E_CORRECTION] = max(2.0 * p[kalman.HEADING, kalman.RATE, lane], 0.0)
        e[helm.E_HEADING_SD] = math.sqrt(p[kalman.HEADING, kalman.HEADING, lane])
        e[helm.E_BIAS], e[helm.E_SPEED] = f.x[kalman.BIAS], f.x[kalman.SPEED]
        e[helm.E_SPEED_SD] = math.sqrt(p[kalman.SPEED, kalman.SPEED, lane])
        e[helm.E_FACTOR] = f.x[kalman.FACTOR]
    command_rad = own[OWN_COMMAND_RAD]
    wave_period_s = 2.0 * math.pi / exp_of(f, OMEGA, f.n[LOG_OMEGA])
    seen_rad = error_rad if begun else np.nan
    oscillation.watch(pilot.swing, now_s, seen_rad, own[GOAL_RAD], command_rad, e, wave_period_s)
    demand_rad = command_rad if armed else 0.0
    if steered and begun:
        softness = pilot.swing[oscillation.SOFTNESS]
        demand_rad = helm.steer(law, pilot.helm, e, error_rad, command_rad, step_s, softness)
    else:
        pilot.helm[helm.REF_HEADING] = pilot.helm[helm.FOLLOWED_BIAS] = np.nan
    own[OWN_COMMAND_RAD] = limited_command(
        command_rad, demand_rad, step_s, boat.limit_rad, boat.slew_rad_s, boat.deadband_rad
    )


@compiled
def next_deadline(deadline_s: float, newest_s: float) -> float:
    """Return when the next tick is due: the ticks draw near to the compass (firmware_py/system/clock.py)."""
    if math.isnan(newest_s):
        return deadline_s + (PERIOD_S + 0.0)
    ahead_s = deadline_s - (newest_s + LOCK_MARGIN_S)
    off_s = ahead_s - PERIOD_S * math.floor(ahead_s / PERIOD_S + 0.5)
    return deadline_s + (PERIOD_S + clamp(-LOCK_GAIN * off_s, -LOCK_SLEW * PERIOD_S, LOCK_SLEW * PERIOD_S))
