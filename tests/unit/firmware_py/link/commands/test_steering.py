"""Heading and position setpoints by messages."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.intents import Answer, SteerHeading, SteerPosition, Verdict
from firmware_py.common.records import FixType, PositionSample
from firmware_py.common.reports import Home

NAN, INF = math.nan, math.inf
YAW_ONLY = 0b1001_1111_1111 | 0x200  # everything but yaw ignored
VELOCITY_ONLY = 0b1101_1110_0111
POSITION_ONLY = 0b1101_1111_1000
FIX = {"position": PositionSample(0.0, FixType.FIX_3D, math.radians(40), math.radians(10)), "position_ok": True}
# MAV_FRAME
LOCAL_NED, GLOBAL_RELATIVE_ALT_INT, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED, BODY_FRD = 1, 6, 7, 8, 9, 12
RELATIVE_FRAMES = (LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED, BODY_FRD)
GLOBAL_FRAMES = (0, 3, 5, 6, 10, 11)  # GLOBAL, GLOBAL_RELATIVE_ALT, GLOBAL_TERRAIN_ALT, and their _INT forms
METRES_PER_DEGREE = math.radians(1.0) * EARTH_RADIUS_M


HALF_PITCH_RAD = 0.5 * math.acos(0.0098)  # of an attitude that points up so steeply that it has no heading


def about(angle_rad):
    return pytest.approx(angle_rad, abs=1e-6)


def attitude(q, mask=0b0100_0111):
    return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, mask, q, NAN, NAN, NAN, NAN)


def local(mask, *, frame=LOCAL_NED, x=0.0, y=0.0, vx=0.0, vy=0.0, yaw=0.0):
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, x, y, NAN, vx, vy, NAN, NAN, NAN, NAN, yaw, NAN
    )


def over_globe(mask, *, frame=GLOBAL_RELATIVE_ALT_INT, lat=0, lon=0, vx=0.0, vy=0.0, yaw=0.0):
    return mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, mask, lat, lon, NAN, vx, vy, NAN, NAN, NAN, NAN, yaw, NAN
    )


def test_position_target_without_a_position_is_refused(rig, texts):
    replies = texts(rig.send(over_globe(POSITION_ONLY)))
    assert replies == ["SET_POSITION_TARGET_GLOBAL_INT: position 0, 0 is not accepted"]
    assert rig.request_handler.intents == []
    rig.send(over_globe(POSITION_ONLY, lat=1))
    assert len(rig.request_handler.intents) == 1


@pytest.mark.parametrize("yaw_rad", [0.0, 0.5, math.pi / 2, 3.0, -0.1, -3.0])
@pytest.mark.parametrize(("roll_rad", "pitch_rad"), [(0.0, 0.0), (0.3, -0.4)])
def test_heading_goal_is_the_yaw_of_the_attitude(rig, yaw_rad, roll_rad, pitch_rad):
    cr, sr, cp, sp = (f(a / 2) for a in (roll_rad, pitch_rad) for f in (math.cos, math.sin))
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    q = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    assert rig.send(attitude(q)) == []
    (goal,) = rig.request_handler.intents
    assert 0.0 <= goal.heading_rad < 2 * math.pi
    assert math.remainder(goal.heading_rad - yaw_rad, 2 * math.pi) == about(0.0)


@pytest.mark.parametrize(
    "message",
    [
        attitude((0, 0, 0, 0)),
        attitude((NAN, 0, 0, 1)),
        attitude((INF, 0, 0, 0)),
        attitude((3e38, 3e38, 3e38, 3e38)),
        attitude((1, 1, 1, 1)),
        attitude((0.989, 0, 0, 0)),
        attitude((1.011, 0, 0, 0)),
        attitude((math.cos(HALF_PITCH_RAD), 0, math.sin(HALF_PITCH_RAD), 0)),
        attitude((math.sqrt(0.5), 0, math.sqrt(0.5), 0)),  # bow straight up
        attitude((1, 0, 0, 0), mask=0b1000_0000),
    ],
)
def test_attitude_without_a_heading_is_refused(rig, texts, message):
    (text,) = texts(rig.send(message))
    assert text.startswith("SET_ATTITUDE_TARGET: ")
    assert rig.request_handler.intents == []


@pytest.mark.parametrize(
    "message",
    [attitude((math.cos(half), 0, math.sin(half), 0)) for half in (0.0, 0.5 * math.acos(0.0105))]
    + [attitude((0.9905, 0, 0, 0)), attitude((1.0095, 0, 0, 0))],
)
def test_attitude_nearly_upright_or_normalized_has_a_heading(rig, message):
    assert rig.send(message) == []
    assert rig.request_handler.intents == [SteerHeading(about(0.0))]


BY_VELOCITY, BY_YAW = SteerHeading(about(math.pi / 2), over_ground=True), SteerHeading(about(1.5))


@pytest.mark.parametrize(
    ("mask", "goal"),
    [
        (0b1, BY_VELOCITY), (0b10, BY_VELOCITY), (0b11, BY_VELOCITY), (0b01_0011, BY_YAW), (0b0_1011, BY_YAW),
        (0xFBFF, BY_YAW), (0b100_0001_0011, None),
    ],
)  # fmt: skip
@pytest.mark.parametrize("make", [local, over_globe])
def test_each_bit_of_a_mask_ignores_its_field(rig, make, mask, goal):
    rig.tick()
    rig.send(make(mask, vy=1.0, yaw=1.5))
    assert rig.request_handler.intents == ([] if goal is None else [goal])


@pytest.mark.parametrize("frame", range(22))
def test_positions_are_accepted_in_global_or_local_frames(rig, frame):
    fix = FIX["position"]
    rig.tick(**FIX, home=Home(fix.latitude_rad, fix.longitude_rad, 0.0))
    rig.send(over_globe(POSITION_ONLY, frame=frame, lat=10**8, lon=10**8))
    assert len(rig.request_handler.intents) == (frame in GLOBAL_FRAMES)
    rig.request_handler.requests.clear()
    rig.send(local(POSITION_ONLY, frame=frame, x=1.0))
    assert len(rig.request_handler.intents) == (frame in (LOCAL_NED, *RELATIVE_FRAMES))


@pytest.mark.parametrize(
    ("fields", "is_accepted"),
    [
        *(({"mask": POSITION_ONLY, axis: sign * 1e5}, True) for axis in "xy" for sign in (1, -1)),
        *(({"mask": POSITION_ONLY, axis: sign * 1.0001e5}, False) for axis in "xy" for sign in (1, -1)),
        *(({"mask": VELOCITY_ONLY, axis: sign * 1e3}, True) for axis in ("vx", "vy") for sign in (1, -1)),
        *(({"mask": VELOCITY_ONLY, axis: sign * 1001.0}, False) for axis in ("vx", "vy") for sign in (1, -1)),
        ({"mask": VELOCITY_ONLY, "vx": 0.00105}, True),
        ({"mask": VELOCITY_ONLY, "vx": 0.00099}, False),
        *(({"mask": YAW_ONLY, "yaw": sign * 6.283}, True) for sign in (1, -1)),
        *(({"mask": YAW_ONLY, "yaw": sign * 6.284}, False) for sign in (1, -1)),
    ],
)
def test_values_of_local_targets_have_limits(rig, fields, is_accepted):
    rig.tick(**FIX, home=Home(0.0, 0.0, 0.0))
    rig.send(local(**fields))
    assert len(rig.request_handler.intents) == is_accepted


@pytest.mark.parametrize(
    ("message", "goal"),
    [
        (local(YAW_ONLY, yaw=1.5), SteerHeading(about(1.5))),
        (local(YAW_ONLY, yaw=-1.5), SteerHeading(about(2 * math.pi - 1.5))),
        (local(YAW_ONLY, frame=BODY_OFFSET_NED, yaw=0.5), SteerHeading(about(1.5))),  # heading is 1.0
        (local(VELOCITY_ONLY, vx=0.0, vy=0.5), SteerHeading(about(math.pi / 2), over_ground=True)),
        (local(VELOCITY_ONLY, frame=BODY_NED, vx=0.5), SteerHeading(about(1.0), over_ground=True)),
        (over_globe(YAW_ONLY, yaw=1.5), SteerHeading(about(1.5))),
        (over_globe(VELOCITY_ONLY, vx=-1.0, yaw=NAN), SteerHeading(about(math.pi), over_ground=True)),
        (over_globe(0, lat=401_000_000, lon=-15, yaw=1.0), SteerPosition(about(math.radians(40.1)), about(-2.6e-8))),
        (over_globe(POSITION_ONLY, lat=1, lon=2, yaw=NAN, vx=NAN), SteerPosition(about(0), about(0))),
    ],
)
def test_position_targets_follow_their_masks(rig, message, goal):
    assert rig.send(message) == []
    assert rig.request_handler.intents == [goal]


@pytest.mark.parametrize(
    ("frame", "x", "y", "north_m", "east_m"),
    [
        (LOCAL_NED, 300.0, -200.0, 300.0, -200.0),
        (LOCAL_OFFSET_NED, 300.0, 0.0, 300.0, 0.0),
        (BODY_OFFSET_NED, 100.0, 0.0, 54.03, 84.15),
        (BODY_NED, 0.0, 100.0, -84.15, 54.03),
    ],
)
def test_local_positions_are_relative_to_home_or_to_the_boat(rig, frame, x, y, north_m, east_m):
    fix = FIX["position"]
    rig.tick(**FIX, home=Home(fix.latitude_rad, fix.longitude_rad, 0.0))
    rig.send(local(POSITION_ONLY, frame=frame, x=x, y=y))
    (goal,) = rig.request_handler.intents
    assert (math.degrees(goal.latitude_rad) - 40.0) * METRES_PER_DEGREE == pytest.approx(north_m, abs=0.01)
    scale = METRES_PER_DEGREE * math.cos(math.radians(40))
    assert (math.degrees(goal.longitude_rad) - 10.0) * scale == pytest.approx(east_m, abs=0.01)


@pytest.mark.parametrize("frame", [LOCAL_NED, LOCAL_OFFSET_NED, BODY_OFFSET_NED])
def test_local_positions_need_a_position(rig, texts, frame):
    for changes in (
        {},
        FIX | {"position_ok": False},
        {"position": PositionSample(0.0, FixType.FIX_3D), "position_ok": True},
    ):
        rig.tick(seconds=100.0, **changes)
        assert "for a relative goal" in texts(rig.send(local(POSITION_ONLY, frame=frame, x=1.0, y=1.0)))[0]
    assert rig.request_handler.intents == []


def test_body_frames_need_a_heading(rig, texts):
    for changes in ({"heading_ok": False}, {"heading_rad": None}):
        rig.tick(seconds=100.0, **changes)
        assert len(texts(rig.send(local(YAW_ONLY, frame=BODY_OFFSET_NED, yaw=0.5)))) == 1
    assert rig.request_handler.intents == []


@pytest.mark.parametrize(
    "message",
    [
        *(local(YAW_ONLY, yaw=bad) for bad in (NAN, INF, -INF, 6.4, 1e30)),
        *(local(VELOCITY_ONLY, vx=bad) for bad in (NAN, INF, 0.0, 1e-9, 3e38)),
        *(local(POSITION_ONLY, x=bad) for bad in (NAN, INF, 1e6, -3e38)),
        local(YAW_ONLY, frame=2, yaw=1.0),
        local(YAW_ONLY, frame=255, yaw=1.0),
        local(0xFFFF, yaw=1.0),
        over_globe(POSITION_ONLY, lat=2**31 - 1),
        over_globe(POSITION_ONLY, lon=-(2**31)),
        over_globe(POSITION_ONLY, frame=LOCAL_NED),
        over_globe(YAW_ONLY, yaw=NAN),
        over_globe(0xFFFF),
    ],
)
def test_invalid_targets_are_refused_and_reported(rig, texts, message):
    rig.tick(**FIX)
    assert len(texts(rig.send(message))) == 1
    assert rig.request_handler.intents == []


def test_repeated_refusals_are_reported_once(rig, texts):
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "not in GUIDED")
    replies = [message for _ in range(50) for message in rig.send(attitude((1, 0, 0, 0)))]
    assert texts(replies) == ["not in GUIDED"]
    assert len(rig.request_handler.intents) == 50


@pytest.mark.parametrize(("others", "wait_s", "count"), [(127, 1.9, 128), (128, 1.9, 130), (0, 2.0, 2)])
def test_relative_goals_are_compared_with_the_last_128_of_two_seconds(rig, others, wait_s, count):
    goal = rig.frame(local(VELOCITY_ONLY, frame=LOCAL_OFFSET_NED, vx=1.0))
    rig.give(goal)
    for _ in range(others):
        rig.send(local(VELOCITY_ONLY, frame=LOCAL_OFFSET_NED, vx=1.0))
    rig.now_s += wait_s
    rig.give(goal)
    assert len(rig.request_handler.intents) == count


def test_local_positions_are_refused_near_the_poles(rig, texts):
    rig.tick(position=PositionSample(0.0, FixType.FIX_3D, math.pi / 2, 0.0), position_ok=True)
    (text,) = texts(rig.send(local(POSITION_ONLY, frame=LOCAL_OFFSET_NED, x=1.0, y=1.0)))
    assert text.endswith("local position beyond a pole")
    assert rig.request_handler.intents == []


@pytest.mark.parametrize(
    ("frame", "count"),
    [(LOCAL_NED, 2), *((frame, 1) for frame in RELATIVE_FRAMES)],
)
def test_relative_goal_that_several_links_repeat_is_executed_once(make_rig, frame, count):
    rig = make_rig(addresses=("one", "two"))
    rig.tick(**FIX)
    goal = rig.frame(local(VELOCITY_ONLY, frame=frame, vx=1.0, vy=1.0))
    rig.give(goal, "one")
    rig.tick(heading_rad=2.0, **FIX)
    rig.give(goal, "two")
    assert len(rig.request_handler.intents) == count
    rig.send(local(VELOCITY_ONLY, frame=frame, vx=1.0, vy=1.0))  # the next one, with its own number
    assert len(rig.request_handler.intents) == count + 1
