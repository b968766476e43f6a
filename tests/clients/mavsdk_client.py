"""A client written with MAVSDK, run as a process of its own: acts as a ground station and reports what it receives.

    python mavsdk_client.py URL RESULTS.json

MAVSDK's library writes to standard output from threads of its own, so the results go to a
file. Exit code 77 says that MAVSDK cannot be had on this machine.
"""

import json
import math
import sys
import time
from pathlib import Path

# First: it ends the process with 77 where MAVSDK cannot be had.
from mavsdk_system import METRES_PER_DEGREE, autopilot, wait

# isort: split
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.action import Action
from mavsdk.plugins.info import Info
from mavsdk.plugins.offboard import Attitude, Offboard
from mavsdk.plugins.param import Param
from mavsdk.plugins.param.param import ProtocolVersion
from mavsdk.plugins.telemetry import Telemetry

FAR_M = 20_000.0


def refusal(call, *arguments):
    """The name of the result that an impossible request gets."""
    try:
        call(*arguments)
    except MavsdkError as error:
        return error.result.name
    return "SUCCESS"


def patiently(call):
    """The answer to a question that MAVSDK refuses until it has heard enough."""
    answers = []

    def answered():
        try:
            answers.append(call())
        except MavsdkError:
            return False
        return True

    wait(answered, call.__name__)
    return answers[0]


def public(record):
    return {key: value for key, value in vars(record).items() if not key.startswith("_")}


class Session:
    """One connection and what has been seen on it."""

    def __init__(self, system):
        self.system = system
        self.telemetry = Telemetry(system)
        self.action = Action(system)
        self.seen = {}

    def identify(self):
        info = Info(self.system)
        self.seen["system"] = self.system.get_system_id()
        self.seen["components"] = self.system.component_ids()
        self.seen["autopilot"] = self.system.autopilot_type().name
        self.seen["identification"] = public(patiently(info.get_identification))
        self.seen["version"] = public(patiently(info.get_version))

    def look(self):
        telemetry = self.telemetry
        wait(telemetry.health_all_ok, "health_all_ok")
        wait(lambda: telemetry.battery().voltage_v > 0.0, "a battery")
        wait(lambda: telemetry.raw_gps().timestamp_us > 0, "a fix")
        wait(lambda: math.isfinite(telemetry.position().latitude_deg), "a position")
        wait(lambda: math.isfinite(telemetry.home().latitude_deg), "a home")
        wait(lambda: math.isfinite(telemetry.attitude_euler().yaw_deg), "an attitude")
        wait(telemetry.armed, "the first heartbeat since the plugin is there: it counts as disarmed until then")
        for name in ("health", "position", "home", "battery", "gps_info", "attitude_euler", "velocity_ned"):
            self.seen[name] = public(getattr(telemetry, name)())
        self.seen["home"].pop("q")
        self.seen["mode"] = telemetry.flight_mode().name

    def set_parameters(self):
        param = Param(self.system)
        everything = param.get_all_params()
        self.seen["int_params"] = {row.name: row.value for row in everything.int_params}
        self.seen["float_params"] = {row.name: row.value for row in everything.float_params}
        self.seen["custom_params"] = len(everything.custom_params)
        param.set_param_float("CTL_K1", 33.25)
        param.set_param_int("LOOP_RATE_HZ", 12)
        self.seen["too_large"] = refusal(param.set_param_float, "CTL_K1", 1e30)
        self.seen["not_a_number"] = refusal(param.set_param_float, "CTL_K1", math.nan)
        self.seen["unknown"] = refusal(param.get_param_float, "NO_SUCH")
        self.seen["read_back"] = [param.get_param_float("CTL_K1"), param.get_param_int("LOOP_RATE_HZ")]
        param.set_param_int("LOOP_RATE_HZ", 10)
        self.seen["custom"] = [
            refusal(param.get_param_custom, "CTL_K1"),
            refusal(param.set_param_custom, "CTL_K1", "high"),
        ]

    def set_extended_parameters(self):
        """In PARAM_EXT: after a list without an answer MAVSDK waits for ever for other answers."""
        param = Param(self.system)
        refusal(param.select_component, 1, ProtocolVersion.EXT)  # it says UNKNOWN though it is done
        everything = param.get_all_params()
        self.seen["extended"] = {row.name: row.value for row in (*everything.int_params, *everything.float_params)}
        param.set_param_float("CTL_K1", 34.5)
        self.seen["extended_too_large"] = refusal(param.set_param_float, "CTL_K1", 1e30)
        self.seen["extended_back"] = [param.get_param_float("CTL_K1"), param.get_param_int("LOOP_RATE_HZ")]
        param.set_param_float("CTL_K1", 33.25)

    def arm(self):
        self.action.disarm()
        wait(lambda: not self.telemetry.armed(), "disarmed")
        self.action.arm()
        wait(self.telemetry.armed, "armed")

    def hold(self):
        self.action.hold()
        wait(lambda: self.telemetry.flight_mode().name == "HOLD", "mode HOLD")
        self.action.return_to_launch()
        wait(lambda: self.telemetry.flight_mode().name == "RETURN_TO_LAUNCH", "mode RTL")
        self.action.hold()
        wait(lambda: self.telemetry.flight_mode().name == "HOLD", "mode HOLD again")
        self.seen["no_such_command"] = refusal(self.action.takeoff)
        self.seen["mode_after_refusals"] = self.telemetry.flight_mode().name

    def steer_by_attitude(self):
        offboard = Offboard(self.system)
        offboard.set_attitude(Attitude(0.0, 0.0, 10.0, 0.0))
        offboard.start()
        self.arrive("attitude", 10.0, 3.0)
        offboard.stop()
        wait(lambda: self.telemetry.flight_mode().name == "HOLD", "mode HOLD again")

    def go_to(self):
        """So far that the bearing stays the same, 30 degrees."""
        here = self.telemetry.position()
        north_deg = FAR_M * math.cos(math.radians(30.0)) / METRES_PER_DEGREE
        east_deg = FAR_M * math.sin(math.radians(30.0)) / METRES_PER_DEGREE / math.cos(math.radians(here.latitude_deg))
        self.action.goto_location(here.latitude_deg + north_deg, here.longitude_deg + east_deg, 0.0, math.nan)
        self.arrive("goto", 30.0, 8.0)  # the estimated drift after a fast turn decays slowly
        self.seen["last_position"] = public(self.telemetry.position())

    def arrive(self, name, wanted_deg, tolerance_deg):
        """Wait until the heading has come near the goal and stays there for a second."""
        since_s = time.monotonic()

        def settled():
            nonlocal since_s
            if abs(math.remainder(self.telemetry.heading().heading_deg - wanted_deg, 360.0)) < tolerance_deg:
                return time.monotonic() - since_s > 1.0
            since_s = time.monotonic()
            return False

        wait(settled, f"heading {wanted_deg:g} deg by {name}")
        self.seen[name] = [self.telemetry.heading().heading_deg, self.telemetry.flight_mode().name]


def main():
    url, results = sys.argv[1:]
    with autopilot(url) as system:
        session = Session(system)
        for step in (
            session.identify,
            session.look,
            session.set_parameters,
            session.set_extended_parameters,
            session.arm,
            session.hold,
            session.steer_by_attitude,
            session.go_to,
        ):
            print(f"step {step.__name__}", flush=True)
            step()
        Path(results).write_text(json.dumps(session.seen, indent=1))


if __name__ == "__main__":
    main()
