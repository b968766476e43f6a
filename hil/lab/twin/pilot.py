"""The autopilots in a tick: goals, sources, estimate, the watch over the helm, and the helm."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hil.lab.compiled import compiled
from hil.lab.lane_math import fails, least, most, within, wrap_pi, wrap_two_pi
from hil.lab.lane_rows import fields, lanes_of, rows
from hil.lab.lanes import COUNT, any_of, bits_of, where
from hil.lab.twin import helm, intake, kalman, late_answer, oscillation, sources, wave_filter
from hil.lab.twin.afloat import DEADLINE_S, FEEDBACK_RAD, FIXES, HEADINGS, Afloat
from hil.lab.twin.crew import (
    ARMED,
    BEFORE_S,
    FIX_NEXT,
    FIXED,
    GOAL_RAD,
    GOALS,
    HEADING_NEXT,
    NEXT_GOAL_S,
    OWN_COMMAND_RAD,
    OWN_ERROR_RAD,
    OWN_HEADING_RAD,
    OWN_RATE_RAD_S,
    SAMPLE_S,
    STEERED_S,
    THERE,
    USED,
    Crew,
    Orders,
)  # fmt: skip
from hil.lab.twin.devices import THERE_S
from hil.lab.twin.kalman import COLUMNS, Floats
from hil.lab.twin.learning import LOG_OMEGA
from hil.lab.twin.wave_filter_state import OMEGA, RUDDER, SAMPLE_T, STARTED, begin_filters, exp_of

ARMED_S, GUARD_S = 0.28, 0.003  # when the operator has armed and set the mode; before a tick the link waits
LOCK_MARGIN_S, LOCK_SLEW, LOCK_GAIN = 0.002, 0.005, 0.1
PERIOD_S = 1.0 / 10.0
LONGEST_STEP_S = 1.0

Lanes = Any


@compiled
def begin_pilots(crew: Crew, orders: Orders, on: Lanes) -> None:
    """Be the autopilots before their first ticks."""
    me, boats = crew.pilots[0], fields(crew.boats[0])
    begin_filters(crew.filters[0], on, boats.cruise_speed_m_s)
    oscillation.begin_watch(rows(me.swing, on))
    late_answer.begin_watch(rows(me.late, on))
    sources.begin(rows(me.source, on))
    state, e, own = rows(me.helm, on), rows(me.known, on), rows(me.own, on)
    state[helm.REF_HEADING] = state[helm.FOLLOWED_BIAS] = np.nan
    for i in range(4):
        e[helm.M_K + i] = boats.model[i]
    e[helm.LIMIT], e[helm.TRIM] = boats.limit_rad, boats.trim_rad
    own[BEFORE_S] = own[SAMPLE_S] = own[GOAL_RAD] = np.nan
    own[NEXT_GOAL_S] = lanes_of(orders.given_s, 0)


@compiled
def take_goals(own: Floats, orders: Orders, on: Lanes, now_s: Lanes) -> None:
    """Take the goals that have come by the tick; see whether the boats are armed and GUIDED by then."""
    mine = rows(own, on)
    armed = now_s > ARMED_S + GUARD_S
    mine[ARMED] = where(armed, 1.0, 0.0)
    while True:
        next_s = mine[NEXT_GOAL_S]
        come = bits_of(on & armed & ((next_s <= ARMED_S) | (next_s < now_s - GUARD_S)))
        if come == 0:
            break
        for k in range(COUNT):
            if come >> k & 1 > 0:
                number = int(own[GOALS, k])
                own[GOAL_RAD, k] = wrap_two_pi(orders.goals_rad[number, k])
                own[GOALS, k] = number + 1
                own[NEXT_GOAL_S, k] = orders.given_s[number + 1, k] if number + 1 < orders.given_s.shape[0] else np.inf
    mine[GOAL_RAD] = where(armed & math.isnan(mine[GOAL_RAD]), mine[OWN_HEADING_RAD], mine[GOAL_RAD])


@compiled
def look(crew: Crew, orders: Orders, at: Afloat, on: Lanes) -> Lanes:
    """Begin a tick: take goals, look at what is there, and choose the sources; return which have a fix."""
    me, now_s = crew.pilots[0], rows(at.clock, on)[DEADLINE_S]
    take_goals(me.own, orders, on, now_s)
    intake.judge_sources(crew, at, on, now_s)
    own = rows(me.own, on)
    own[USED] = where(rows(me.source, on)[sources.IN_USE] == sources.COMPASS, own[THERE], 0.0)
    own[FIXED] = intake.count_fixes(at, on, now_s)
    own[HEADING_NEXT] = own[FIX_NEXT] = 0.0
    return on & (own[FIXED] > 0.0)


@compiled
def settle(crew: Crew, at: Afloat, on: Lanes, now_s: Lanes) -> None:
    """Forget the samples of a tick, and carry the headings on to it."""
    me, f, boats, counts = crew.pilots[0], crew.filters[0], fields(crew.boats[0]), rows(at.counts, on)
    own, w, place = rows(me.own, on), rows(f.w, on), 0
    there, fix_count = own[THERE], own[FIXED]
    while any_of(on & (fix_count > place)):
        s, t_s = rows(me.source, on & (fix_count > place)), rows(at.fixes, on)[4 * place + THERE_S]
        sources.learn_interval(s, sources.FIX_TOLD, sources.FIX_INTERVAL, t_s, boats.position_timeout_s)
        place += 1
    counts[HEADINGS], counts[FIXES] = counts[HEADINGS] - there, counts[FIXES] - fix_count
    intake.drop(at.headings, 2, there, counts[HEADINGS], on)
    intake.drop(at.fixes, 4, fix_count, counts[FIXES], on)
    w[RUDDER] = boats.servo_sign * rows(at.clock, on)[FEEDBACK_RAD]
    begun = on & (w[STARTED] > 0.0)
    mine = rows(me.own, begun)
    mine[OWN_HEADING_RAD], mine[OWN_RATE_RAD_S] = wave_filter.predict_heading(f, boats, begun, now_s)
    sampled_s = where(mine[SAMPLE_S] > w[SAMPLE_T], mine[SAMPLE_S], w[SAMPLE_T])
    mine[SAMPLE_S] = where(rows(me.source, on)[sources.IN_USE] == sources.COURSE, now_s, sampled_s)
    mine[STEERED_S] = now_s


@compiled
def know(crew: Crew, on: Lanes) -> None:
    """Fill what the helms know of estimates that have begun."""
    me, f, p = crew.pilots[0], crew.filters[0], crew.covariances[0].p
    e, own, x = rows(me.known, on), rows(me.own, on), rows(f.x, on)
    e[helm.E_HEADING], e[helm.E_RATE] = own[OWN_HEADING_RAD], own[OWN_RATE_RAD_S]
    e[helm.E_CORRECTION] = most(2.0 * lanes_of(p, kalman.place(kalman.HEADING, kalman.RATE)), 0.0)
    e[helm.E_HEADING_SD] = math.sqrt(lanes_of(p, kalman.HEADING * COLUMNS + kalman.HEADING))
    e[helm.E_BIAS], e[helm.E_BIAS_MEAN] = x[kalman.BIAS], x[kalman.BIAS_MEAN]
    e[helm.E_SPEED] = x[kalman.SPEED]
    e[helm.E_SPEED_SD] = math.sqrt(lanes_of(p, kalman.SPEED * COLUMNS + kalman.SPEED))
    e[helm.E_FACTOR] = x[kalman.FACTOR]


@compiled
def steer(crew: Crew, orders: Orders, on: Lanes, now_s: Lanes) -> None:
    """Watch over the helms and steer: the next rudder commands."""
    me, f, boats = crew.pilots[0], crew.filters[0], fields(crew.boats[0])
    own, e, before_s = rows(me.own, on), rows(me.known, on), rows(me.own, on)[BEFORE_S]
    step_s = where(math.isnan(before_s), 0.0, least(most(0.0, now_s - before_s), LONGEST_STEP_S))
    begun, armed = rows(f.w, on)[STARTED] > 0.0, own[ARMED] > 0.0
    lost_after_s = sources.timeout_s(rows(me.source, on)[sources.INTERVAL], boats.compass_timeout_s)
    steered = armed & (now_s - own[SAMPLE_S] <= lost_after_s) & fails(math.isnan(own[GOAL_RAD]))
    error_rad = where(steered, wrap_pi(own[GOAL_RAD] - own[OWN_HEADING_RAD]), np.nan)
    own[OWN_ERROR_RAD] = error_rad
    know(crew, on & begun)
    command_rad, swing, state = own[OWN_COMMAND_RAD], rows(me.swing, on), rows(me.helm, on)
    wave_period_s = 2.0 * math.pi / exp_of(f, OMEGA, rows(f.n, on)[LOG_OMEGA])
    seen_rad = where(begun, error_rad, np.nan)
    trim_rad = rows(f.x, on)[kalman.BIAS_MEAN]
    oscillation.watch(swing, rows(me.late, on), now_s, seen_rad, own[GOAL_RAD], command_rad, trim_rad, e, wave_period_s)
    demand_rad, helmed = where(armed, command_rad, 0.0), on & steered & begun
    if any_of(helmed):
        asked_rad = helm.steer(
            rows(orders.laws, on), rows(me.helm, helmed), rows(me.known, helmed), error_rad, command_rad, step_s,
            swing[oscillation.SOFTNESS],
        )  # fmt: skip
        demand_rad = where(helmed, asked_rad, demand_rad)
    state[helm.REF_HEADING] = where(helmed, state[helm.REF_HEADING], np.nan)
    state[helm.FOLLOWED_BIAS] = where(helmed, state[helm.FOLLOWED_BIAS], np.nan)
    own[OWN_COMMAND_RAD] = helm.limited_command(
        command_rad, demand_rad, step_s, boats.limit_rad, boats.slew_rad_s, boats.deadband_rad
    )
    own[BEFORE_S] = now_s


@compiled
def next_deadline(deadline_s: Lanes, newest_s: Lanes) -> Lanes:
    """Return when the next ticks are due: they draw near to the compass (firmware_py/system/clock.py)."""
    ahead_s = deadline_s - (newest_s + LOCK_MARGIN_S)
    off_s = ahead_s - PERIOD_S * math.floor(ahead_s / PERIOD_S + 0.5)
    drawn_s = within(-LOCK_GAIN * off_s, -LOCK_SLEW * PERIOD_S, LOCK_SLEW * PERIOD_S)
    return deadline_s + where(math.isnan(newest_s), PERIOD_S + 0.0, PERIOD_S + drawn_s)
