"""What autopilots take in at a tick: sentences that are there, the source that they choose, the estimate's samples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.lane_math import fails, within
from hil.lab.lane_rows import fields, lanes_of, rows
from hil.lab.lanes import any_of, where
from hil.lab.twin import kalman, over_ground, sources, wave_filter
from hil.lab.twin.afloat import FIRST_FIX_S, FIXES, GIVEN, HEADINGS, Afloat
from hil.lab.twin.crew import FIX_NEXT, FIXED, HEADING_NEXT, NEWEST_S, STEERED_S, THERE, USED, Crew
from hil.lab.twin.devices import LOST, SAID_RAD, THERE_S
from hil.lab.twin.kalman import COLUMNS, Floats
from hil.lab.twin.wave_filter_state import FIX_T, STARTED, begin_anew

EPOCH_ENDS_AFTER_S = 0.5
WIDEST_COURSE_RAD = radians(20.0)
Lanes = Any


@compiled
def nth(queue: Floats, width: int, field: int, number: Lanes, on: Lanes) -> Lanes:
    """Return a field of each lane's sentence of a number in a queue."""
    sentences = rows(queue, on)
    found, place = sentences[field], 1
    while any_of(on & (number >= place)):
        found = where(number == place, sentences[width * place + field], found)
        place += 1
    return found


@compiled
def drop(queue: Floats, width: int, gone: Lanes, left: Lanes, on: Lanes) -> None:
    """Forget the first sentences of each lane, of which so many are left."""
    place = 0
    moves = on & (gone > 0.0) & (left > 0.0)
    while any_of(moves):
        for field in range(width):
            rows(queue, moves)[width * place + field] = nth(queue, width, field, gone + place, moves)
        place += 1
        moves = moves & (left > place)


@compiled
def judge_sources(crew: Crew, at: Afloat, on: Lanes, now_s: Lanes) -> None:
    """Judge the samples that are there and choose the sources; note how many headings there are."""
    me, f, boats, counts = crew.pilots[0], crew.filters[0], fields(crew.boats[0]), rows(at.counts, on)
    s, own = rows(me.source, on), rows(me.own, on)
    lost_after_s = sources.timeout_s(s[sources.INTERVAL], boats.compass_timeout_s)
    fix_lost_after_s = sources.timeout_s(s[sources.FIX_INTERVAL], boats.position_timeout_s)
    anew = on & sources.contradicts(s, now_s, lost_after_s)
    if any_of(anew):
        begin_anew(f, anew)
        sources.begin_anew(rows(me.source, anew))
    sources.decay_offset(s, within(now_s - own[STEERED_S], 0.0, 1.0))
    x, w = rows(f.x, on), rows(f.w, on)
    begun = w[STARTED] > 0.0
    expected_rad = where(begun, x[kalman.FLOAT] + x[kalman.WAVE], np.nan)
    own[NEWEST_S], own[THERE] = np.nan, 0.0
    place, there = 0, on
    while True:
        headings = rows(at.headings, on)
        t_s, said_rad = headings[2 * place + THERE_S], headings[2 * place + SAID_RAD]
        there = there & (counts[HEADINGS] > place) & (t_s <= now_s)
        if not any_of(there):
            break
        spoken, mine = rows(me.source, there), rows(me.own, there)
        sources.add_sample(spoken, t_s, said_rad, said_rad, expected_rad)
        sources.learn_interval(spoken, sources.TOLD, sources.INTERVAL, t_s, boats.compass_timeout_s)
        place += 1
        mine[NEWEST_S], mine[THERE] = t_s, float(place)
    course_ok = (
        begun
        & (now_s - w[FIX_T] <= fix_lost_after_s)
        & (math.sqrt(lanes_of(crew.covariances[0].p, kalman.HEADING * COLUMNS + kalman.HEADING)) <= WIDEST_COURSE_RAD)
        & (x[kalman.SPEED] >= boats.course_speed_m_s)
    )
    sources.select(s, now_s, lost_after_s, boats.frozen_s, course_ok)


@compiled
def count_fixes(at: Afloat, on: Lanes, now_s: Lanes) -> Lanes:
    """Return how many fixes are there; the first epoch is given when nothing has followed it for a while."""
    counts, ready, place = rows(at.counts, on), on, 0
    count = where(on, 0.0, 0.0)
    while True:
        t_s = rows(at.fixes, on)[4 * place + THERE_S]
        followed = (counts[GIVEN] != 0.0) | (now_s - rows(at.clock, on)[FIRST_FIX_S] > EPOCH_ENDS_AFTER_S)
        ready = ready & (counts[FIXES] > place) & (t_s <= now_s) & followed
        if not any_of(ready):
            return count
        rows(at.counts, ready)[GIVEN] = 1.0
        place += 1
        count = where(ready, float(place), count)


@compiled
def estimate(crew: Crew, at: Afloat, on: Lanes) -> None:
    """Take a tick's samples in, in order of their times, a heading first; kind by kind, so that most lanes join."""
    me, f, c, boats = crew.pilots[0], crew.filters[0], crew.covariances[0], fields(crew.boats[0])
    own = rows(me.own, on)
    while True:
        heading, fix = own[HEADING_NEXT], own[FIX_NEXT]
        heading_s, no_fix = nth(at.headings, 2, THERE_S, heading, on), fix >= own[FIXED]
        heads = on & (heading < own[USED]) & (no_fix | (heading_s <= nth(at.fixes, 4, THERE_S, fix, on)))
        fixes = on & fails(heads | no_fix)
        if not any_of(heads | fixes):
            return
        if any_of(fixes):
            mine = rows(c.fix, fixes)
            for field in range(4):
                mine[field] = nth(at.fixes, 4, field, fix, fixes)
            rows(me.own, fixes)[FIX_NEXT] = fix + 1.0
            over_ground.correct_velocities(f, c, boats, fixes & (mine[LOST] == 0.0))
        if any_of(heads):
            rows(c.to_s, heads)[0] = heading_s
            said_rad = nth(at.headings, 2, SAID_RAD, heading, heads)
            rows(c.sample, heads)[0] = said_rad + rows(me.source, heads)[sources.OFFSET]
            rows(me.own, heads)[HEADING_NEXT] = heading + 1.0
            wave_filter.correct_headings(f, c, boats, heads)
