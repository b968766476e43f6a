"""What is looked at on a boat while something stands broken aboard."""

from __future__ import annotations

from collections.abc import Callable

from hil.lab.drill.boat import DrillBoat

ON_COURSE_DEG = 15.0
ARRIVED_S = 130.0  # after an order to turn as far as the moments do
LET_GO_S, AT_REST_S, TRIED_S = 1.0, 4.0, 9.5  # after the telling: pulls no more; so long at least; before it is tried
MOVED_DEG, TURN_DEG = 1.0, 90.0

Check = Callable[[DrillBoat, float], str]  # what is wrong a while after it broke, or ""


def in_mode(name: str) -> Check:
    """She is in a mode."""
    return lambda boat, _at_s: "" if (mode := boat.mode()) == name else f"mode {mode}, not {name}"


def on_course(boat: DrillBoat, _at_s: float) -> str:
    """She steers on for her goal."""
    boat.run(max(0.0, boat.goal_s + ARRIVED_S - boat.now_s))
    error_deg = boat.error_deg()
    return "" if abs(error_deg) < ON_COURSE_DEG else f"{error_deg:+.0f} deg off her goal"


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
