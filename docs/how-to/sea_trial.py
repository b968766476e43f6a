"""A zigzag or circles by rudder alone, over MAVLink: python sea_trial.py zigzag|circle [URL]; arm her before."""

import math
import sys
from collections.abc import Iterator

from pymavlink import mavutil

STICK = 667  # of 1000 for RUD_LIMIT_DEG: 20 of 30 deg
ZIGZAG_RAD, SWINGS = math.radians(20.0), 10
CIRCLES = 2  # to either side


def zigzag(headings: Iterator[float]) -> Iterator[int]:
    """Put the rudder over whenever she has turned 20 deg from where she began, to the other side."""
    began_rad, side = next(headings), 1
    yield side
    for _ in range(SWINGS):
        while side * math.remainder(next(headings) - began_rad, math.tau) < ZIGZAG_RAD:
            yield side
        side = -side


def circle(headings: Iterator[float]) -> Iterator[int]:
    """Turn twice to starboard, then twice to port."""
    for side in (1, -1):
        turned_rad, before_rad = 0.0, next(headings)
        while side * turned_rad < CIRCLES * math.tau:
            yield side
            now_rad = next(headings)
            turned_rad += math.remainder(now_rad - before_rad, math.tau)
            before_rad = now_rad


def heard(boat: mavutil.mavfile) -> Iterator[float]:
    """Yield her headings as they come, as long as she is armed and heard; else end with what is the matter."""
    while boat.motors_armed():
        attitude = boat.recv_match(type="ATTITUDE", blocking=True, timeout=10)
        if attitude is None:
            sys.exit("no heading has come for 10 s")
        yield attitude.yaw
    sys.exit("she is not armed: arm her and begin anew")


def main(what: str, url: str = "udpin:0.0.0.0:14550") -> None:
    """Steer by stick in MANUAL, then let her keep the heading that she has."""
    boat = mavutil.mavlink_connection(url)
    boat.wait_heartbeat()
    boat.set_mode("MANUAL")
    for side in {"zigzag": zigzag, "circle": circle}[what](heard(boat)):
        boat.mav.manual_control_send(boat.target_system, 0, side * STICK, 0, 0, 0)
    boat.set_mode("STEERING")


if __name__ == "__main__":
    main(*sys.argv[1:])
