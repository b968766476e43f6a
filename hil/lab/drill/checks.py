"""What is looked at on a boat while something stands broken aboard."""

from __future__ import annotations

from collections.abc import Callable

from hil.lab.drill.boat import DrillBoat
from hil.sim.ground_station import GUIDED

ON_COURSE_DEG = 15.0
# By the track alone, soon after the start: 13 deg rms, since positions wander by 0.9 m while the boat goes 4 m.
BY_TRACK_DEG = 35.0
ARRIVED_S = 130.0  # after an order to turn as far as the moments do
LET_GO_S, AT_REST_S, TRIED_S = 1.0, 4.0, 9.5  # after the telling: pulls no more; so long at least; before it is tried
MOVED_DEG, TURN_DEG = 1.0, 90.0

LIMIT_DEG = 31.5  # of the rudder, as it comes: 30, and what a shaft swings beyond
KEPT_S = 5.0

Check = Callable[[DrillBoat, float], str]  # what is wrong a while after it broke, or ""


def in_mode(name: str) -> Check:
    """She is in a mode."""
    return lambda boat, _at_s: "" if (mode := boat.mode()) == name else f"mode {mode}, not {name}"


def on_course(boat: DrillBoat, _at_s: float) -> str:
    """The boat steers for its goal."""
    boat.run(max(0.0, boat.goal_s + ARRIVED_S - boat.now_s))
    limit_deg, error_deg = BY_TRACK_DEG if boat.steers_by_track() else ON_COURSE_DEG, boat.error_deg()
    return "" if abs(error_deg) < limit_deg else f"{error_deg:+.0f} deg off the goal"


def both(*checks: Check) -> Check:
    """Look at several things, one after the other."""

    def check(boat: DrillBoat, at_s: float) -> str:
        return "; ".join(wrong for one in checks if (wrong := one(boat, at_s)))

    return check


def as_before(boat: DrillBoat, at_s: float) -> str:
    """She is in the mode that she was in before, and comes back to her goal when it was one."""
    if wrong := in_mode(boat.mode_before)(boat, at_s):
        return f"{wrong}, after it was over"
    if boat.mode_before != "GUIDED":
        return ""
    end_s = max(boat.goal_s, boat.now_s) + ARRIVED_S
    there_s: float | None = None
    while boat.now_s < end_s:
        if abs(boat.error_deg()) >= ON_COURSE_DEG:
            there_s = None
        elif there_s is None:
            there_s = boat.now_s
        elif boat.now_s - there_s > KEPT_S:
            return ""
        boat.run(0.5)
    return f"{boat.error_deg():+.0f} deg off her goal, long after it was over"


def said_besides(text: str) -> Check:
    """Something more has been told since it broke."""
    return lambda boat, at_s: "" if boat.said(text, at_s) is not None else f"{text!r} not told"


def not_over(recovery: str, nearly: Callable[[DrillBoat], object], seconds: float) -> Check:
    """It does not pass for over while it is nearly so."""

    def check(boat: DrillBoat, _at_s: float) -> str:
        nearly(boat)
        since_s = boat.now_s
        early_s = boat.until(recovery, seconds, since_s)
        return "" if early_s is None else f"{recovery!r} told {early_s - since_s:.0f} s after it was nearly over"

    return check


def turns_to(heading_deg: float, within_s: float) -> Check:
    """She comes to a heading, as the next leg of her way asks."""

    def check(boat: DrillBoat, _at_s: float) -> str:
        boat.goal_deg, end_s = heading_deg, boat.now_s + within_s
        while abs(boat.error_deg()) >= ON_COURSE_DEG:
            if boat.now_s >= end_s:
                return f"{boat.error_deg():+.0f} deg off the next leg"
            boat.run(1.0)
        return ""

    return check


def obeyed(boat: DrillBoat, at_s: float) -> str:
    """A failsafe has acted; the operator orders otherwise, and that stands."""
    acted = in_mode("HOLD")(boat, at_s)
    boat.set_mode(GUIDED)
    boat.steer(boat.goal_deg)
    boat.run(KEPT_S)
    return acted or in_mode("GUIDED")(boat, at_s)


def rested(boat: DrillBoat, _at_s: float) -> str:
    """When the autopilot ended the rudder lay amidships."""
    return "" if abs(boat.rested_deg) < 1.0 else f"rudder left at {boat.rested_deg:+.1f} deg"


def within_limit(boat: DrillBoat) -> str:
    """The rudder was never put beyond its limit."""
    worst_deg = boat.farthest_deg
    return "" if worst_deg <= LIMIT_DEG else f"rudder at {worst_deg:.1f} deg, beyond its limit"


def amidships(boat: DrillBoat, _at_s: float) -> str:
    """The rudder has gone amidships."""
    return "" if abs(boat.rudder_deg()) < 0.5 else f"rudder at {boat.rudder_deg():+.1f} deg"


def relieved(text: str) -> Check:
    """Told that her rudder suffers, she stops pulling at it, and leaves it where it stands though ordered to turn."""

    def check(boat: DrillBoat, at_s: float) -> str:
        told_s = boat.said(text, at_s)
        if told_s is None or boat.now_s > told_s + TRIED_S - AT_REST_S:
            return ""  # the other of a pair hides it, or has taken so long that it may be tried meanwhile
        goal_deg = boat.goal_deg
        boat.steer(goal_deg + TURN_DEG)
        wrong = _pulled(boat, told_s)
        boat.steer(goal_deg)  # what the other of a pair is looked at for
        return wrong

    return check


def _pulled(boat: DrillBoat, told_s: float) -> str:
    """Say how the rudder is pulled at, soon after the telling and for as long as it is not tried."""
    boat.run(max(0.0, told_s + LET_GO_S - boat.now_s))
    stood_deg, end_s = boat.rudder_deg(), boat.now_s + AT_REST_S
    while boat.now_s < end_s:
        if boat.servo.motor.pulls():
            return f"the servo pulls {boat.now_s - told_s:.1f} s after the telling"
        if abs(boat.rudder_deg() - stood_deg) > MOVED_DEG:
            return f"the rudder is moved {boat.now_s - told_s:.1f} s after the telling"
        boat.run(0.1)
    return ""
