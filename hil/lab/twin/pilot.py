"""The autopilot in a tick: goals, sources, estimate, the watch over the helm, and the helm."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.tune.twins import clamp, limited_command, wrap_pi, wrap_two_pi
from hil.lab.twin import helm, kalman, oscillation, over_ground, sources, wave_filter
from hil.lab.twin.afloat import FEEDBACK_RAD, FIRST_FIX_S, FIXES, GIVEN, HEADINGS, Afloat, drop
from hil.lab.twin.devices import LOST, SAID_RAD, THERE_S
from hil.lab.twin.kalman import Floats
from hil.lab.twin.learning import LOG_OMEGA
from hil.lab.twin.wave_filter import WaveFilter

EPOCH_ENDS_AFTER_S = 0.5
ARMED_S, GUARD_S = 0.28, 0.003  # when the operator has armed and set the mode; before a tick the link waits
LOCK_MARGIN_S, LOCK_SLEW, LOCK_GAIN = 0.002, 0.005, 0.1
PERIOD_S = 1.0 / 10.0
WIDEST_COURSE_RAD = radians(20.0)

# Of Pilot.own, where NaN is what there is not yet.
(BEFORE_S, OWN_COMMAND_RAD, OWN_HEADING_RAD, OWN_RATE_RAD_S, STEERED_S, SAMPLE_S, GOAL_RAD, GOALS, NEWEST_S,
 OWN_ERROR_RAD) = range(10)  # fmt: skip


class Boat(NamedTuple):
    """What the autopilot is told by its parameters; `model` is K, T, alpha and the speed that they are of."""

    model: tuple[float, float, float, float]
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


class Pilot(NamedTuple):
    """What the autopilot remembers."""

    waves: WaveFilter
    helm: Floats
    known: Floats
    swing: Floats
    source: Floats
    own: Floats


@compiled
def new_pilot(boat: Boat) -> Pilot:
    """Return the autopilot before its first tick."""
    pilot = Pilot(
        wave_filter.new_filter(boat.cruise_speed_m_s),
        np.zeros(helm.HELM_STATES),
        np.zeros(helm.KNOWN),
        oscillation.new_watch(),
        sources.new_sources(),
        np.zeros(10),
    )
    pilot.helm[helm.REF_HEADING] = pilot.helm[helm.FOLLOWED_BIAS] = np.nan
    e = pilot.known
    e[helm.M_K], e[helm.M_T], e[helm.M_ALPHA], e[helm.M_SPEED] = boat.model
    e[helm.LIMIT], e[helm.TRIM] = boat.limit_rad, boat.trim_rad
    pilot.own[BEFORE_S] = pilot.own[SAMPLE_S] = pilot.own[GOAL_RAD] = np.nan
    return pilot


@compiled
def take_goals(own: Floats, task: Task, now_s: float) -> bool:
    """Take the goals that have come by the tick; return whether the boat is armed and GUIDED by then."""
    armed = now_s > ARMED_S + GUARD_S
    number = int(own[GOALS])
    while armed and number < task.given_s.size:
        if not (task.given_s[number] <= ARMED_S or task.given_s[number] < now_s - GUARD_S):
            break
        own[GOAL_RAD] = wrap_two_pi(task.goals_rad[number])
        number += 1
    own[GOALS] = number
    if armed and math.isnan(own[GOAL_RAD]):
        own[GOAL_RAD] = own[OWN_HEADING_RAD]
    return armed


@compiled
def judge_source(pilot: Pilot, boat: Boat, at: Afloat, now_s: float) -> int:
    """Judge the samples that are there and choose the source; return how many headings there are."""
    f, s, own, headings = pilot.waves, pilot.source, pilot.own, at.headings
    lost_after_s = sources.timeout_s(s[sources.INTERVAL], boat.compass_timeout_s)
    fix_lost_after_s = sources.timeout_s(s[sources.FIX_INTERVAL], boat.position_timeout_s)
    if sources.contradicts(s, now_s, lost_after_s):
        wave_filter.begin_anew(f)
        sources.begin_anew(s)
    sources.decay_offset(s, clamp(now_s - own[STEERED_S], 0.0, 1.0))
    begun = f.w[wave_filter.STARTED] > 0.0
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
        and now_s - f.w[wave_filter.FIX_T] <= fix_lost_after_s
        and math.sqrt(f.p[kalman.HEADING, kalman.HEADING]) <= WIDEST_COURSE_RAD
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
def estimate(pilot: Pilot, boat: Boat, at: Afloat, now_s: float) -> None:
    """Take a tick's samples in, in order of their times, a heading before a velocity, and carry the heading on."""
    f, s, own, headings, fixes = pilot.waves, pilot.source, pilot.own, at.headings, at.fixes
    there = judge_source(pilot, boat, at, now_s)
    heading_count, fix_count = there if s[sources.IN_USE] == sources.COMPASS else 0, count_fixes(at, now_s)
    heading = fix = 0
    while heading < heading_count or fix < fix_count:
        if heading < heading_count and (fix >= fix_count or headings[heading, THERE_S] <= fixes[fix, THERE_S]):
            heading_rad = headings[heading, SAID_RAD] + s[sources.OFFSET]
            wave_filter.correct_heading(f, boat.model, headings[heading, THERE_S], heading_rad)
            heading += 1
        else:
            if fixes[fix, LOST] == 0.0:
                over_ground.correct_velocity(f, boat.model, fixes[fix])
            fix += 1
    for k in range(fix_count):
        sources.learn_interval(s, sources.FIX_TOLD, sources.FIX_INTERVAL, fixes[k, THERE_S], boat.position_timeout_s)
    drop(headings, there, at.counts[HEADINGS])
    drop(fixes, fix_count, at.counts[FIXES])
    at.counts[HEADINGS] -= there
    at.counts[FIXES] -= fix_count
    f.w[wave_filter.RUDDER] = boat.servo_sign * at.clock[FEEDBACK_RAD]
    if f.w[wave_filter.STARTED] > 0.0:
        own[OWN_HEADING_RAD], own[OWN_RATE_RAD_S] = wave_filter.predict_heading(f, boat.model, now_s)
        own[SAMPLE_S] = now_s if s[sources.IN_USE] == sources.COURSE else f.w[wave_filter.SAMPLE_T]
        own[STEERED_S] = now_s


@compiled
def steer(pilot: Pilot, boat: Boat, law: Floats, now_s: float, step_s: float, armed: bool) -> None:  # noqa: FBT001 - compiled
    """Watch over the helm and steer: the next rudder command."""
    f, own, e = pilot.waves, pilot.own, pilot.known
    begun = f.w[wave_filter.STARTED] > 0.0
    lost_after_s = sources.timeout_s(pilot.source[sources.INTERVAL], boat.compass_timeout_s)
    steered = armed and now_s - own[SAMPLE_S] <= lost_after_s and not math.isnan(own[GOAL_RAD])
    own[OWN_ERROR_RAD] = error_rad = wrap_pi(own[GOAL_RAD] - own[OWN_HEADING_RAD]) if steered else np.nan
    if begun:
        e[helm.E_HEADING], e[helm.E_RATE] = own[OWN_HEADING_RAD], own[OWN_RATE_RAD_S]
        e[helm.E_CORRECTION] = max(2.0 * f.p[kalman.HEADING, kalman.RATE], 0.0)
        e[helm.E_HEADING_SD] = math.sqrt(f.p[kalman.HEADING, kalman.HEADING])
        e[helm.E_BIAS], e[helm.E_SPEED] = f.x[kalman.BIAS], f.x[kalman.SPEED]
        e[helm.E_SPEED_SD] = math.sqrt(f.p[kalman.SPEED, kalman.SPEED])
        e[helm.E_FACTOR] = f.x[kalman.FACTOR]
    command_rad = own[OWN_COMMAND_RAD]
    wave_period_s = 2.0 * math.pi / math.exp(f.n[LOG_OMEGA])
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
