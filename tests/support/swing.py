"""Logged ticks of a voyage for a compass swing: straight legs in all directions, without waves."""

import math
import random

from firmware_py.common.angles import TWO_PI, radians
from firmware_py.common.intents import Request
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderCommand,
    Tick,
)
from firmware_py.core.state import State
from firmware_py.core.state_codec import state_to_text
from firmware_py.log.reader import LoggedTick
from support.plans import placed


def voyage(legs=30, leg_s=900, restart=False, requests=()):
    """Yield ticks every 2 s of straight legs; the compass heading is 5 deg too small on all headings."""
    courses, north_m, east_m, restart_s = random.Random(1), 0.0, 0.0, 0.0
    text = state_to_text(State.at_start(ParameterSet().replaced("CMP_DEV_B", 2.0)))
    for index in range(legs * leg_s // 2):
        if index % (leg_s // 2) == 0:
            compass_rad = courses.uniform(0.0, TWO_PI)
        if restart and index == legs * leg_s // 4:
            restart_s = 2.0 * index
        t_s = 2.0 * index - restart_s
        heading_rad = compass_rad + radians(5.0)
        north, east = 0.1 + 0.6 * math.cos(heading_rad), 0.6 * math.sin(heading_rad)
        north_m, east_m = north_m + 2.0 * north, east_m + 2.0 * east
        course_rad = math.atan2(east, north) % TWO_PI
        fix = PositionSample(t_s, FixType.FIX_3D, *placed(north_m, east_m), 0.0, math.hypot(north, east), course_rad)
        tick_requests = tuple(Request(t_s, intent) for intent in requests) if index == 5 else ()
        headings = (HeadingSample(t_s, compass_rad, NorthReference.TRUE),)
        inputs = Inputs(Tick(index, t_s, 0.0, 0, 0.5), headings, (fix,), requests=tick_requests)
        yield LoggedTick(inputs, RudderCommand(0.0, torque_on=True), text if index == 0 else None, gap=False)
