"""A ground station with mavutil; its time-outs name the missing message."""

import math
import time

import pytest

PATIENCE_S = 45.0  # for any event; other tests may use the machine at the same time
GROUND_STATION, NO_AUTOPILOT = 6, 8  # MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID
TAIL_LINES = 25


def fail(directory, complaint):
    """Fail with the last lines of all program logs in the directory of the test."""
    output = [complaint]
    for path in sorted(directory.rglob("*.log")):
        output += [f"--- end of {path.name}:", *path.read_text(errors="replace").splitlines()[-TAIL_LINES:]]
    pytest.fail("\n".join(output))


class Station:
    """A mavutil connection, with time-outs that name the missing message."""

    def __init__(self, link, directory):
        self.link = link
        self._directory = directory
        self._next_s = 0.0
        self.mav = link.mav
        self.receive("HEARTBEAT")
        self.show_presence()  # the boat sends telemetry only to peers that have replied to it

    def show_presence(self):
        """Send a heartbeat, as stations do each second."""
        self._next_s = time.monotonic() + 1.0
        self.mav.heartbeat_send(GROUND_STATION, NO_AUTOPILOT, 0, 0, 0)

    def receive(self, kind, wanted=lambda _: True):
        """Return the next message of a kind for which `wanted` is true."""
        deadline_s = time.monotonic() + PATIENCE_S
        last = None
        while time.monotonic() < deadline_s:
            if time.monotonic() > self._next_s:
                self.show_presence()
            message = self.link.recv_match(type=kind, blocking=True, timeout=1.0)
            if message is not None:
                if wanted(message):
                    return message
                last = message
        return fail(self._directory, f"no {kind} as wanted within {PATIENCE_S:g} s; the last one: {last}")

    def command(self, number, *parameters):
        """Send a COMMAND_LONG and return the result."""
        self.mav.command_long_send(1, 1, number, 0, *parameters, *[0.0] * (7 - len(parameters)))
        return self.receive("COMMAND_ACK", lambda ack: ack.command == number).result

    def set_parameter(self, name, value, kind):
        """Send a PARAM_SET and return the value that comes back."""
        self.mav.param_set_send(1, 1, name.encode(), value, kind)
        return self.receive("PARAM_VALUE", lambda row: row.param_id == name).param_value

    def parameter(self, name):
        """Ask for the value of a parameter."""
        self.mav.param_request_read_send(1, 1, name.encode(), -1)
        return self.receive("PARAM_VALUE", lambda row: row.param_id == name).param_value

    def wait_for_goal(self, goal_deg, tolerance_deg):
        """Wait until the boat reports this heading as its goal."""
        self.receive("ATTITUDE_TARGET", lambda target: abs(off_deg(yaw_deg(target.q), goal_deg)) < tolerance_deg)

    def wait_until_steady(self, goal_deg, tolerance_deg, steady_s):
        """Wait until the heading has been near the goal for steady_s; return the ATTITUDE messages of this time."""
        messages = []
        while not messages or messages[-1].time_boot_ms - messages[0].time_boot_ms < 1000.0 * steady_s:
            messages.append(self.receive("ATTITUDE"))
            if abs(off_deg(math.degrees(messages[-1].yaw), goal_deg)) > tolerance_deg:
                messages.clear()
        return messages


def yaw_deg(q):
    return math.degrees(2.0 * math.atan2(q[3], q[0]))


def off_deg(heading_deg, goal_deg):
    """Return the difference of two headings, from -180 to 180 deg."""
    return math.remainder(heading_deg - goal_deg, 360.0)
