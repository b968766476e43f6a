"""Command a zigzag or circles in MANUAL over MAVLink: python sea_trial.py zigzag|circle [URL]. Arm first."""

import math
import sys
from collections.abc import Iterator

from pymavlink import mavutil

STICK_DEFLECTION = 667  # of 1000 for RUD_LIMIT_DEG: 20 of 30 deg
ZIGZAG_RAD, HALF_CYCLES = math.radians(20.0), 10
CIRCLES_PER_SIDE = 2


def zigzag(headings: Iterator[float]) -> Iterator[int]:
    """Yield the side of the rudder, which changes 20 deg to either side of the initial heading."""
    start_rad, side = next(headings), 1
    yield side
    for _ in range(HALF_CYCLES):
        while side * math.remainder(next(headings) - start_rad, math.tau) < ZIGZAG_RAD:
            yield side
        side = -side


def circle(headings: Iterator[float]) -> Iterator[int]:
    """Yield the side of the rudder: two circles to starboard, then two to port."""
    for side in (1, -1):
        turned_rad, previous_rad = 0.0, next(headings)
        while side * turned_rad < CIRCLES_PER_SIDE * math.tau:
            yield side
            heading_rad = next(headings)
            turned_rad += math.remainder(heading_rad - previous_rad, math.tau)
            previous_rad = heading_rad


def headings_of(boat: mavutil.mavfile) -> Iterator[float]:
    """Yield the heading of each ATTITUDE message while the boat is armed; otherwise exit with the reason."""
    while boat.motors_armed():
        attitude = boat.recv_match(type="ATTITUDE", blocking=True, timeout=10)
        if attitude is None:
            sys.exit("no heading for 10 s: check the link, then start again")
        yield attitude.yaw
    sys.exit("the boat is not armed: arm it, then start again")


def main(manoeuvre: str, url: str = "udpin:0.0.0.0:14550") -> None:
    """Steer in MANUAL, then keep the heading in STEERING."""
    boat = mavutil.mavlink_connection(url)
    boat.wait_heartbeat()
    boat.set_mode("MANUAL")
    for side in {"zigzag": zigzag, "circle": circle}[manoeuvre](headings_of(boat)):
        boat.mav.manual_control_send(boat.target_system, 0, side * STICK_DEFLECTION, 0, 0, 0)
    boat.set_mode("STEERING")


if __name__ == "__main__":
    main(*sys.argv[1:])
