"""Heading goals with pymavlink: all messages that set one, the turn to it, and refused values."""

import math
import re

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

NAN, INFINITE = math.nan, math.inf
GUIDED, HOLD = 15, 4
FAR_M = 10_000.0
METRES_PER_DEGREE = 111_195.0
STEADY_S = 10.0
SETTLED_S = 70.0  # the filter adapts its noise levels in the first minute
TOLERANCE_DEG = 3.0
ESTIMATE_DEG = 1.2

IGNORE_ALL = 0b0000_1111_1111_1111
YAW_ONLY = IGNORE_ALL & ~0b0100_0000_0000
VELOCITY_ONLY = IGNORE_ALL & ~0b0011_1000
POSITION_ONLY = IGNORE_ALL & ~0b0111


def send_attitude(station, heading_deg):
    half = math.radians(heading_deg) / 2.0
    station.mav.set_attitude_target_send(0, 1, 1, 0b0111, [math.cos(half), 0.0, 0.0, math.sin(half)], 0, 0, 0, 0)


def send_local_target(station, mask, north=0.0, east=0.0, yaw=0.0):
    """Send a position and a velocity, both north and east; the mask selects one of them."""
    frame = mavlink.MAV_FRAME_LOCAL_NED
    station.mav.set_position_target_local_ned_send(
        0, 1, 1, frame, mask, north, east, 0, north, east, 0, 0, 0, 0, yaw, 0
    )


def send_global_target(station, mask, position=(0, 0), velocity=(0.0, 0.0), yaw=0.0):
    frame = mavlink.MAV_FRAME_GLOBAL_INT
    station.mav.set_position_target_global_int_send(0, 1, 1, frame, mask, *position, 0, *velocity, 0, 0, 0, 0, yaw, 0)


def north_and_east(length, bearing_deg):
    """Return the north and east components of a length in a direction."""
    return length * math.cos(math.radians(bearing_deg)), length * math.sin(math.radians(bearing_deg))


def distant_position(station, bearing_deg):
    """Return a position in 1e-7 degrees, so far from the boat that the bearing stays the same."""
    here = station.receive("GLOBAL_POSITION_INT")
    north_deg, east_deg = north_and_east(FAR_M / METRES_PER_DEGREE, bearing_deg)
    return here.lat + round(1e7 * north_deg), here.lon + round(1e7 * east_deg / math.cos(math.radians(here.lat * 1e-7)))


def reposition(station, bearing_deg):
    """Send DO_REPOSITION in HOLD, as a COMMAND_INT with the flag that changes the mode."""
    assert station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, HOLD) == mavlink.MAV_RESULT_ACCEPTED
    x, y = distant_position(station, bearing_deg)
    number, frame = mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_FRAME_GLOBAL_INT
    station.mav.command_int_send(1, 1, frame, number, 0, 0, -1, 1, 0, NAN, x, y, 0)
    assert station.receive("COMMAND_ACK", lambda ack: ack.command == number).result == mavlink.MAV_RESULT_ACCEPTED


def guided_waypoint(station, bearing_deg):
    x, y = distant_position(station, bearing_deg)
    number, frame = mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_FRAME_GLOBAL_INT
    station.mav.mission_item_int_send(1, 1, 0, frame, number, 2, 1, 0, 0, 0, 0, x, y, 0)
    assert station.receive("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED


def accepted_command(number, *parameters):
    """Return a function that sends a command to a station and checks that it is accepted."""

    def send(station):
        assert station.command(number, *parameters) == mavlink.MAV_RESULT_ACCEPTED

    return send


YAW, YAW_SPEED = mavlink.MAV_CMD_CONDITION_YAW, mavlink.MAV_CMD_NAV_SET_YAW_SPEED
CHANGE_HEADING = mavlink.MAV_CMD_GUIDED_CHANGE_HEADING

# Name, function that sends it, resulting goal (different from the one before), tolerance.
EXACT, ABOUT = 0.1, 2.0  # a course and a bearing depend on the fixes of the receiver
GOALS = (
    ("CONDITION_YAW, absolute", accepted_command(YAW, 50, 0, 0, 0), 50, EXACT),
    ("GUIDED_CHANGE_HEADING, course", accepted_command(CHANGE_HEADING, 0, 20, 0), 20, ABOUT),
    ("GUIDED_CHANGE_HEADING, heading", accepted_command(CHANGE_HEADING, 1, 350, 0), 350, EXACT),
    # The boat holds 350 by then: a relative heading is relative to the present one. Unit tests have the other cases.
    ("CONDITION_YAW, relative to starboard", accepted_command(YAW, 30, 0, 1, 1), 20, TOLERANCE_DEG),
    ("NAV_SET_YAW_SPEED, absolute", accepted_command(YAW_SPEED, 10, 0, 0), 10, EXACT),
    ("SET_ATTITUDE_TARGET", lambda boat: send_attitude(boat, 25), 25, EXACT),
    ("LOCAL_NED, yaw", lambda boat: send_local_target(boat, YAW_ONLY, yaw=math.radians(-10)), 350, EXACT),
    ("LOCAL_NED, velocity", lambda boat: send_local_target(boat, VELOCITY_ONLY, *north_and_east(0.5, 15)), 15, ABOUT),
    ("LOCAL_NED, position", lambda boat: send_local_target(boat, POSITION_ONLY, *north_and_east(FAR_M, 55)), 55, ABOUT),
    ("GLOBAL_INT, yaw", lambda boat: send_global_target(boat, YAW_ONLY, yaw=math.radians(5)), 5, EXACT),
    ("GLOBAL_INT, velocity", lambda boat: send_global_target(boat, VELOCITY_ONLY, velocity=(1.0, 1.0)), 45, ABOUT),
    (
        "GLOBAL_INT, position",
        lambda boat: send_global_target(boat, POSITION_ONLY, distant_position(boat, 330)),
        330,
        ABOUT,
    ),
    ("guided waypoint", lambda boat: guided_waypoint(boat, 60), 60, ABOUT),
    ("DO_REPOSITION", lambda boat: reposition(boat, 20), 20, ABOUT),
)
REACHED = {"GUIDED_CHANGE_HEADING, heading"}


def test_heading_goal_of_each_message_is_accepted_and_reached(start_hil, connect):
    hil = start_hil("udpout", scenario="tank", speed="15", seconds=9000, nimble=False)
    station = connect(f"udpin:127.0.0.1:{hil.ports[0]}")
    reached = []
    for name, send, goal_deg, tolerance_deg in GOALS:
        print(f"{name}: {goal_deg} deg")  # shown when the test fails
        send(station)
        station.wait_for_goal(goal_deg, tolerance_deg)
        if name in REACHED:
            station.wait_until_steady(goal_deg, TOLERANCE_DEG, SETTLED_S)
            reached.append((goal_deg, station.wait_until_steady(goal_deg, TOLERANCE_DEG, STEADY_S)))
    truth = hil.end()
    assert len(reached) == len(REACHED)
    for goal_deg, attitudes in reached:
        for message in attitudes[len(attitudes) // 2 :]:  # the first ones may be from the end of the turn
            row = round(message.time_boot_ms / 100.0)  # in lockstep both start at the same time
            assert truth.time_s[row] == pytest.approx(message.time_boot_ms / 1000.0, abs=0.06)
            assert abs(difference_deg(truth.heading_low_rad[row], math.radians(goal_deg))) < TOLERANCE_DEG
            # The telemetry has the heading without the wave yaw, which is 1.5 deg rms in the tank.
            assert abs(difference_deg(truth.heading_low_rad[row], message.yaw)) < ESTIMATE_DEG


def difference_deg(first_rad, second_rad):
    return math.degrees(math.remainder(first_rad - second_rad, 2.0 * math.pi))


DENIED, UNSUPPORTED = mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_UNSUPPORTED
REFUSED = (
    (YAW, (NAN, 0, 0, 0), DENIED),
    (YAW, (INFINITE, 0, 0, 0), DENIED),  # 1e300 in a field of four bytes
    (YAW, (400, 0, 0, 0), DENIED),
    (YAW, (90, 0, 0, NAN), DENIED),
    (CHANGE_HEADING, (1, NAN, 0), DENIED),
    (CHANGE_HEADING, (1, -INFINITE, 0), DENIED),
    (CHANGE_HEADING, (NAN, 90, 0), DENIED),
    (CHANGE_HEADING, (0, 3e38, 0), DENIED),
    (YAW_SPEED, (NAN, 0, 0), DENIED),
    (YAW_SPEED, (INFINITE, 0, 1), DENIED),
    (mavlink.MAV_CMD_DO_REPOSITION, (-1, 1, 0, 0, NAN, 121), DENIED),
    (mavlink.MAV_CMD_DO_REPOSITION, (-1, 1, 0, 0, 36, INFINITE), DENIED),
    (mavlink.MAV_CMD_DO_REPOSITION, (-1, 1, 0, 0, 91, 121), DENIED),
    (mavlink.MAV_CMD_DO_SET_MODE, (1, NAN), DENIED),
    (mavlink.MAV_CMD_DO_SET_MODE, (1, 4.5), DENIED),
    (mavlink.MAV_CMD_DO_SET_MODE, (1, 2), DENIED),
    (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (NAN,), DENIED),
    (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (2,), DENIED),
    (mavlink.MAV_CMD_NAV_TAKEOFF, (), UNSUPPORTED),
    (60_000, (), UNSUPPORTED),
)
# These have no acknowledgement: a text has the reason.
REFUSED_MESSAGES = {
    "SET_ATTITUDE_TARGET": lambda boat: boat.mav.set_attitude_target_send(
        0, 1, 1, 0b0111, [NAN, 0, 0, NAN], 0, 0, 0, 0
    ),
    "SET_POSITION_TARGET_LOCAL_NED": lambda boat: send_local_target(boat, VELOCITY_ONLY, NAN, 1.0),
    "SET_POSITION_TARGET_GLOBAL_INT": lambda boat: send_global_target(boat, YAW_ONLY, yaw=INFINITE),
}


def test_invalid_goals_are_refused_and_change_nothing(start_hil, connect):
    hil = start_hil("udpout", goal="0:37")
    station = connect(f"udpin:127.0.0.1:{hil.ports[0]}")
    station.wait_for_goal(37.0, EXACT)
    # First, because the boat sends at most two texts per second in the long run.
    for name, send in REFUSED_MESSAGES.items():
        send(station)
        station.receive("STATUSTEXT", lambda message, name=name: name in message.text)
    for number, parameters, result in REFUSED:
        assert station.command(number, *parameters) == result, (number, parameters)
    for value in (NAN, INFINITE, 3e38, -1.0):
        assert station.set_parameter("CTL_K1", value, mavlink.MAV_PARAM_TYPE_REAL32) == 40.0
    check_commands_for_others_are_ignored(station)
    station.wait_for_goal(37.0, EXACT)
    heartbeat = station.receive("HEARTBEAT")
    assert (heartbeat.custom_mode, heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED) == (GUIDED, 128)
    events = re.findall(r"(?:info|notice) +(.*)", hil.firmware_log.read_text())
    # At start, and by the two orders of the HIL, which may be in one tick or in two.
    assert events[:2] == ["Mode HOLD", "Heading source: compass A"]
    assert sorted(events[2:]) == ["Armed", "Mode GUIDED"]
    hil.end()


def check_commands_for_others_are_ignored(station):
    """Check that a command for another boat or component is neither executed nor acknowledged."""
    disarm = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    for system, component in ((99, 1), (1, 99)):
        station.mav.command_long_send(system, component, disarm, 0, *[0.0] * 7)
    station.mav.command_long_send(1, 1, mavlink.MAV_CMD_NAV_LAND, 0, *[0.0] * 7)
    assert station.receive("COMMAND_ACK").command == mavlink.MAV_CMD_NAV_LAND
