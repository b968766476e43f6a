"""Commands that do not depend on the state: accepted ones with their intent, and refused ones."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import (
    Arm,
    BenchRudder,
    EnableFence,
    PauseMission,
    Restart,
    SetHome,
    SetMode,
    SteerHeading,
    SteerPosition,
)
from firmware_py.common.mode_table import Mode
from support.link import results

NAN, INF = math.nan, math.inf
ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4  # MAV_RESULT
BAD = (NAN, INF, -INF, 1e30, -3.4e38)
# MAV_CMD
YAW, MODE, HOME, SERVO, REPOSITION, PAUSE, FENCE, YAW_SPEED = 115, 176, 179, 183, 192, 193, 207, 213
RESTART, STANDARD_MODE, ARM, CHANGE_HEADING = 246, 262, 400, 43002
FORCE_ARM, FORCE_RESTART = 21196, 20190226


def degrees(angle_deg):
    return pytest.approx(math.radians(angle_deg))


@pytest.mark.parametrize(
    ("command", "values", "intent"),
    [
        (YAW, (90, NAN, 0, 0, NAN, NAN, NAN), SteerHeading(degrees(90))),
        (YAW, (350, 10, 1, 0), SteerHeading(degrees(350), turn=1)),
        (YAW, (350, 0, -1, 0), SteerHeading(degrees(350), turn=-1)),
        (YAW, (360, 0, 0, 0), SteerHeading(degrees(360))),
        (YAW, (0, 0, 0, 0), SteerHeading(0.0)),
        (YAW, (-360, 0, 0, 1), SteerHeading(degrees(-360), relative=True)),
        *((YAW_SPEED, (angle_deg, 0, 0), SteerHeading(degrees(angle_deg))) for angle_deg in (-360, 360)),
        *((CHANGE_HEADING, (1, angle_deg), SteerHeading(degrees(angle_deg))) for angle_deg in (0, 360)),
        *(
            (
                REPOSITION,
                (-1, flags, 0, NAN, 40.0, -11.5, NAN),
                SteerPosition(degrees(40), degrees(-11.5), change_mode=bool(flags & 1)),
            )
            for flags in (1, 2, 65534, 65535)
        ),
        *((MODE, (flags, 4), SetMode(4)) for flags in (129, 255)),
        (YAW, (20, 0, 1, 1), SteerHeading(degrees(20), relative=True, turn=1)),
        (YAW, (20, 0, -1, 1), SteerHeading(degrees(-20), relative=True, turn=-1)),
        (YAW, (80, 0, 0, 1), SteerHeading(degrees(80), relative=True)),
        (YAW, (-20, 0, 0, 1), SteerHeading(degrees(-20), relative=True)),
        *((MODE, (1, mode), SetMode(mode)) for mode in (0, 4, 15, 0x7FFF0000, 4294967040)),
        (HOME, (1,), SetHome()),
        *(
            (SERVO, (1, 1500 + 500 * deflection), BenchRudder(deflection, 10.0))
            for deflection in (0.0, 1.0, -1.0, 0.25)
        ),
        (REPOSITION, (-1, 0, 0, NAN, 40.0, -11.5, NAN), SteerPosition(degrees(40), degrees(-11.5))),
        (PAUSE, (0,), PauseMission(paused=True)),
        (PAUSE, (1,), PauseMission(paused=False)),
        (FENCE, (1,), EnableFence(True)),
        (FENCE, (0, NAN), EnableFence(False)),
        (YAW_SPEED, (-30, NAN, 1), SteerHeading(degrees(-30), relative=True)),
        (YAW_SPEED, (270, 2, 0), SteerHeading(degrees(270))),
        (RESTART, (1,), Restart()),
        (RESTART, (2,), Restart(shutdown=True)),
        (RESTART, (1, NAN, NAN), Restart()),
        (RESTART, (1, 0, 0, 0, 0, FORCE_RESTART), Restart(force=True)),
        (RESTART, (1, 0, 0, 0, 0, FORCE_RESTART - 1), Restart()),
        (STANDARD_MODE, (6,), SetMode(Mode.AUTO)),
        (STANDARD_MODE, (5,), SetMode(Mode.RTL)),
        (ARM, (1, 0), Arm(True)),
        (ARM, (0, 0), Arm(False)),
        (ARM, (1, NAN), Arm(True)),
        (ARM, (1, FORCE_ARM), Arm(True, force=True)),
        (ARM, (0, FORCE_ARM), Arm(False, force=True)),
        (ARM, (1, 2989), Arm(True)),
        (CHANGE_HEADING, (0, 45, NAN), SteerHeading(degrees(45), over_ground=True)),
        (CHANGE_HEADING, (1, 359.5, 3), SteerHeading(degrees(359.5))),
    ],
)
def test_valid_command_is_accepted(rig, command, values, intent):
    assert results(rig.command(command, *values)) == [ACCEPTED]
    assert rig.request_handler.intents == [intent]


REFUSED = {
    (YAW, DENIED): (
        *((bad, 0, 0, 0) for bad in BAD), *((90, 0, bad, 0) for bad in BAD), *((90, 0, 0, bad) for bad in BAD),
        (361, 0, 0, 0), (-361, 0, 0, 1), (361, 0, 0, 1),
        (-1, 0, 0, 0), (-1, 0, 1, 1), (90, 0, 0.5, 0), (90, 0, 2, 0), (90, 0, 0, 0.5),
    ),
    (MODE, DENIED): (
        (1, NAN), (1, INF), (1, -1), (1, 0.5), (1, 1e30), (0, 4), (NAN, 4), (128, 4), (257, 4), (-1, 4),
    ),
    (HOME, DENIED): (
        (2,), (NAN,), (0, 0, 0, 0, 91, 0), (0, 0, 0, 0, 0, 181), (0, 0, 0, 0, NAN, 1), (0, 0, 0, 0, 1, INF), (0,),
        (0, 0, 0, 0, 45, 9, 1e30), (0, 0, 0, 0, 45, 9, INF),
    ),
    (SERVO, DENIED): ((0, 1500), (2, 1500), (1, 999), (1, 2001), (1, NAN), (NAN, 1500), (1, 0)),
    (REPOSITION, DENIED): (
        (-1, 1), (-1, 65536, 0, 0, 40, 9),
        *((-1, 0, 0, 0, bad, 0, 0) for bad in BAD), *((-1, 0, 0, 0, 0, bad, 0) for bad in BAD),
    ),
    (PAUSE, DENIED): ((NAN,), (2,)),
    (FENCE, DENIED): ((2,), (NAN,), (1, INF), (1, -1), (1, 65536)),
    (FENCE, UNSUPPORTED): ((1, 1), (1, 4), (1, 65535)),
    (YAW_SPEED, DENIED): (*((bad, 0, 0) for bad in BAD), *((1, 0, bad) for bad in BAD), (361, 0, 0), (-361, 0, 0)),
    (RESTART, ACCEPTED): ((0,),),
    (RESTART, DENIED): ((3,), (4,), (NAN,), (-1,)),
    (RESTART, UNSUPPORTED): ((1, 1), (0, 2), (1, 0, 1), (1, INF)),
    (STANDARD_MODE, FAILED): ((0,), (1,), (7,), (99,), (-1,), (0.5,), (NAN,), (INF,)),
    (ARM, DENIED): ((2,), (-1,), (0.5,), (NAN,), (INF,), (3e38,)),
    (CHANGE_HEADING, DENIED): (*((1, bad) for bad in BAD), *((bad, 1) for bad in BAD), (2, 1), (1, 361), (1, -1)),
}  # fmt: skip


@pytest.mark.parametrize(
    ("command", "values", "result"),
    [(command, values, result) for (command, result), rows in REFUSED.items() for values in rows],
)
def test_invalid_command_is_refused(rig, command, values, result):
    assert results(rig.command(command, *values)) == [result]
    assert rig.request_handler.intents == []


@pytest.mark.parametrize(
    ("values", "name", "number"),
    [((YAW, 90, 0, 0, 2), "CONDITION_YAW", 4), ((YAW_SPEED, 1, 0, 2), "NAV_SET_YAW_SPEED", 3)],
)
def test_refusal_names_command_and_parameter(rig, texts, values, name, number):
    assert texts(rig.command(*values)) == [f"{name}: param{number} is neither 0 (absolute) nor 1 (relative)"]


def reposition(x, y, *, frame=6, flags=1.0):
    return mavlink.MAVLink_command_int_message(1, 1, frame, REPOSITION, 0, 0, -1, flags, 0, NAN, x, y, NAN)


def home(*, frame=0, x=450_000_000, y=-1_200_000_000, z=2.0):
    return mavlink.MAVLink_command_int_message(1, 1, frame, HOME, 0, 0, 0, 0, 0, NAN, x, y, z)


def test_command_int_has_positions_as_integers(rig):
    assert results(rig.send(reposition(401_000_000, -115_000_000))) == [ACCEPTED]
    assert results(rig.send(home())) == [ACCEPTED]
    assert results(rig.command(HOME, 0, 0, 0, NAN, 45.0, -120.0, 2.0)) == [ACCEPTED]
    goal, by_int, by_long = rig.request_handler.intents
    assert goal == SteerPosition(degrees(40.1), degrees(-11.5), change_mode=True)
    assert by_int == by_long == SetHome(degrees(45), degrees(-120), 2.0)


@pytest.mark.parametrize(
    "message",
    [
        *(reposition(x, y) for x, y in ((2**31 - 1, 2**31 - 1), (900_000_001, 0), (0, 0), (0, -(2**31)))),
        reposition(1, 1, frame=1),
        reposition(1, 1, flags=NAN),
        reposition(1, 1, flags=-1.0),
        home(frame=1),
        home(x=2**31 - 1, y=2**31 - 1),
    ],
)
def test_invalid_position_in_command_int_is_refused(rig, message):
    assert results(rig.send(message)) == [DENIED]
    assert rig.request_handler.intents == []
