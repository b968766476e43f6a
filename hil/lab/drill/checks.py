"""Checks on the boat during and after a fault; each returns the deviation, or an empty text."""

from __future__ import annotations

from collections.abc import Callable

from hil.lab.drill.boat import DrillBoat
from hil.sim.ground_station import GUIDED

ON_COURSE_DEG = 15.0
# Soon after the start the heading from course over ground has 13 deg rms: 0.9 m position error over 4 m of track.
COURSE_FALLBACK_DEG = 35.0
TURN_TIME_S = 130.0  # for the largest turn of the situations
# Times after the report of a rudder fault: torque is off; minimum time without torque; next attempt of the autopilot.
TORQUE_OFF_S, MIN_REST_S, RETRY_S = 1.0, 4.0, 9.5
MAX_MOVEMENT_DEG, TURN_DEG = 1.0, 90.0

RUDDER_LIMIT_DEG = 31.5  # the limit of 30 deg plus the overshoot of the shaft
SETTLING_S = 5.0

Check = Callable[[DrillBoat, float], str]  # boat, time of the injection


def has_mode(name: str) -> Check:
    """Check that the boat is in a mode."""
    return lambda boat, _at_s: "" if (mode := boat.mode()) == name else f"mode {mode}, not {name}"


def is_on_course(boat: DrillBoat, _at_s: float) -> str:
    """Check that the boat steers to its goal."""
    boat.run(max(0.0, boat.goal_s + TURN_TIME_S - boat.now_s))
    limit_deg, error_deg = COURSE_FALLBACK_DEG if boat.steers_by_course() else ON_COURSE_DEG, boat.error_deg()
    return "" if abs(error_deg) < limit_deg else f"{error_deg:+.0f} deg off the goal"


def all_of(*checks: Check) -> Check:
    """Return a check that returns all deviations of several checks."""

    def check(boat: DrillBoat, at_s: float) -> str:
        return "; ".join(deviation for single_check in checks if (deviation := single_check(boat, at_s)))

    return check


def behaves_as_before(boat: DrillBoat, at_s: float) -> str:
    """Check that the boat is in its mode before the fault and, in GUIDED, returns to its goal."""
    if deviation := has_mode(boat.mode_before)(boat, at_s):
        return f"{deviation}, after the fault"
    if boat.mode_before != "GUIDED":
        return ""
    end_s = max(boat.goal_s, boat.now_s) + TURN_TIME_S
    reached_s: float | None = None
    while boat.now_s < end_s:
        if abs(boat.error_deg()) >= ON_COURSE_DEG:
            reached_s = None
        elif reached_s is None:
            reached_s = boat.now_s
        elif boat.now_s - reached_s > SETTLING_S:
            return ""
        boat.run(0.5)
    return f"{boat.error_deg():+.0f} deg off the goal, long after the fault"


def is_also_reported(text: str) -> Check:
    """Check that another message was sent since the injection."""
    return lambda boat, at_s: "" if boat.report_time(text, at_s) is not None else f"{text!r} not reported"


def stays_active(recovery: str, set_near_limit: Callable[[DrillBoat], object], seconds: float) -> Check:
    """Check that the condition does not end while its value, from `set_near_limit`, is within the hysteresis."""

    def check(boat: DrillBoat, _at_s: float) -> str:
        set_near_limit(boat)
        since_s = boat.now_s
        recovery_s = boat.await_report(recovery, seconds, since_s)
        return (
            ""
            if recovery_s is None
            else f"{recovery!r} reported after {recovery_s - since_s:.0f} s within the hysteresis"
        )

    return check


def reaches_heading(heading_deg: float, within_s: float) -> Check:
    """Check that the boat reaches the heading of the next leg in time."""

    def check(boat: DrillBoat, _at_s: float) -> str:
        boat.goal_deg, end_s = heading_deg, boat.now_s + within_s
        while abs(boat.error_deg()) >= ON_COURSE_DEG:
            if boat.now_s >= end_s:
                return f"{boat.error_deg():+.0f} deg off the next leg"
            boat.run(1.0)
        return ""

    return check


def operator_can_override(boat: DrillBoat, at_s: float) -> str:
    """Check that a failsafe has acted, and that the operator can override it."""
    failsafe_deviation = has_mode("HOLD")(boat, at_s)
    boat.set_mode(GUIDED)
    boat.steer(boat.goal_deg)
    boat.run(SETTLING_S)
    return failsafe_deviation or has_mode("GUIDED")(boat, at_s)


def was_centred_at_end(boat: DrillBoat, _at_s: float) -> str:
    """Check that the rudder was centred when the autopilot ended."""
    return "" if abs(boat.final_rudder_deg) < 1.0 else f"rudder left at {boat.final_rudder_deg:+.1f} deg"


def was_within_limit(boat: DrillBoat) -> str:
    """Check that the rudder stayed within its limit."""
    max_deg = boat.max_rudder_deg
    return "" if max_deg <= RUDDER_LIMIT_DEG else f"rudder at {max_deg:.1f} deg, beyond its limit"


def is_centred(boat: DrillBoat, _at_s: float) -> str:
    """Check that the rudder is centred."""
    return "" if abs(boat.rudder_deg()) < 0.5 else f"rudder at {boat.rudder_deg():+.1f} deg"


def has_torque_off(text: str) -> Check:
    """Check that the autopilot switches the torque off after the report, even if a turn is commanded."""

    def check(boat: DrillBoat, at_s: float) -> str:
        report_s = boat.report_time(text, at_s)
        if report_s is None or boat.now_s > report_s + RETRY_S - MIN_REST_S:
            return ""  # the other fault hides this one, or the autopilot may retry during the check
        goal_deg = boat.goal_deg
        boat.steer(goal_deg + TURN_DEG)
        deviation = _torque_deviation(boat, report_s)
        boat.steer(goal_deg)  # for the check of the other fault
        return deviation

    return check


def _torque_deviation(boat: DrillBoat, report_s: float) -> str:
    """Check that the servo has no torque and the rudder does not move until the next attempt."""
    boat.run(max(0.0, report_s + TORQUE_OFF_S - boat.now_s))
    start_deg, end_s = boat.rudder_deg(), boat.now_s + MIN_REST_S
    while boat.now_s < end_s:
        if boat.servo.motor.is_driving():
            return f"servo torque on {boat.now_s - report_s:.1f} s after the report"
        if abs(boat.rudder_deg() - start_deg) > MAX_MOVEMENT_DEG:
            return f"rudder moves {boat.now_s - report_s:.1f} s after the report"
        boat.run(0.1)
    return ""
