"""A voyage for a swing of the compass: straight legs all round, without waves, as a log would have it."""

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
    """Yield the ticks, one each 2 s, of straight legs by a compass that shows 5 deg too little on all headings."""
    courses, north_m, east_m, late_s = random.Random(1), 0.0, 0.0, 0.0
    text = state_to_text(State.at_start(ParameterSet().replaced("CMP_DEV_B", 2.0)))
    for index in range(legs * leg_s // 2):
        if index % (leg_s // 2) == 0:
            compass_rad = courses.uniform(0.0, TWO_PI)
        if restart and index == legs * leg_s // 4:
            late_s = 2.0 * index
        t_s = 2.0 * index - late_s
        way_rad = compass_rad + radians(5.0)
        north, east = 0.1 + 0.6 * math.cos(way_rad), 0.6 * math.sin(way_rad)
        north_m, east_m = north_m + 2.0 * north, east_m + 2.0 * east
        course_rad = math.atan2(east, north) % TWO_PI
        fix = PositionSample(t_s, FixType.FIX_3D, *placed(north_m, east_m), 0.0, math.hypot(north, east), course_rad)
        sent = tuple(Request(t_s, intent) for intent in requests) if index == 5 else ()
        headings = (HeadingSample(t_s, compass_rad, NorthReference.TRUE),)
        inputs = Inputs(Tick(index, t_s, 0.0, 0, 0.5), headings, (fix,), requests=sent)
        yield LoggedTick(inputs, RudderCommand(0.0, torque_on=True), text if index == 0 else None, gap=False)
