"""A ground station written with MAVSDK, as a separate process: it commands the boat and reports what it receives.

    python mavsdk_client.py URL RESULTS.json

The library of MAVSDK writes to standard output from its own threads, so the results go to a file. Exit code 77: MAVSDK
is not usable on this machine.
"""

import json
import math
import sys
import time
from pathlib import Path

# First: it ends the process with code 77 if MAVSDK is not usable.
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
    """Return the name of the result of a request that should be refused."""
    try:
        call(*arguments)
    except MavsdkError as error:
        return error.result.name
    return "SUCCESS"


def call_until_ready(call):
    """Return the result of a call that MAVSDK refuses until it has received the data."""
    results = []

    def is_ready():
        try:
            results.append(call())
        except MavsdkError:
            return False
        return True

    wait(is_ready, call.__name__)
    return results[0]


def public(record):
    """Return the public attributes of a record."""
    return {key: value for key, value in vars(record).items() if not key.startswith("_")}


class Session:
    """A connection, and the results to report."""

    def __init__(self, system):
        self.system = system
        self.telemetry = Telemetry(system)
        self.action = Action(system)
        self.results = {}

    def identify(self):
        info = Info(self.system)
        self.results["system"] = self.system.get_system_id()
        self.results["components"] = self.system.component_ids()
        self.results["autopilot"] = self.system.autopilot_type().name
        self.results["identification"] = public(call_until_ready(info.get_identification))
        self.results["version"] = public(call_until_ready(info.get_version))

    def read_telemetry(self):
        telemetry = self.telemetry
        wait(telemetry.health_all_ok, "health_all_ok")
        wait(lambda: telemetry.battery().voltage_v > 0.0, "a battery")
        wait(lambda: telemetry.raw_gps().timestamp_us > 0, "a fix")
        wait(lambda: math.isfinite(telemetry.position().latitude_deg), "a position")
        wait(lambda: math.isfinite(telemetry.home().latitude_deg), "a home")
        wait(lambda: math.isfinite(telemetry.attitude_euler().yaw_deg), "an attitude")
        wait(telemetry.armed, "the first heartbeat after the start of the plugin, which reports disarmed before it")
        for name in ("health", "position", "home", "battery", "gps_info", "attitude_euler", "velocity_ned"):
            self.results[name] = public(getattr(telemetry, name)())
        self.results["home"].pop("q")
        self.results["mode"] = telemetry.flight_mode().name

    def set_parameters(self):
        param = Param(self.system)
        parameters = param.get_all_params()
        self.results["int_params"] = {row.name: row.value for row in parameters.int_params}
        self.results["float_params"] = {row.name: row.value for row in parameters.float_params}
        self.results["custom_params"] = len(parameters.custom_params)
        param.set_param_float("CTL_K1", 33.25)
        param.set_param_int("LOOP_RATE_HZ", 12)
        self.results["too_large"] = refusal(param.set_param_float, "CTL_K1", 1e30)
        self.results["not_a_number"] = refusal(param.set_param_float, "CTL_K1", math.nan)
        self.results["unknown"] = refusal(param.get_param_float, "NO_SUCH")
        self.results["read_back"] = [param.get_param_float("CTL_K1"), param.get_param_int("LOOP_RATE_HZ")]
        param.set_param_int("LOOP_RATE_HZ", 10)
        self.results["custom"] = [
            refusal(param.get_param_custom, "CTL_K1"),
            refusal(param.set_param_custom, "CTL_K1", "high"),
        ]

    def set_extended_parameters(self):
        """Use PARAM_EXT; if the list is not answered, MAVSDK never receives another answer."""
        param = Param(self.system)
        refusal(param.select_component, 1, ProtocolVersion.EXT)  # the result is UNKNOWN, although it is accepted
        parameters = param.get_all_params()
        self.results["extended"] = {row.name: row.value for row in (*parameters.int_params, *parameters.float_params)}
        param.set_param_float("CTL_K1", 34.5)
        self.results["extended_too_large"] = refusal(param.set_param_float, "CTL_K1", 1e30)
        self.results["extended_back"] = [param.get_param_float("CTL_K1"), param.get_param_int("LOOP_RATE_HZ")]
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
        self.results["no_such_command"] = refusal(self.action.takeoff)
        self.results["mode_after_refusals"] = self.telemetry.flight_mode().name

    def steer_by_attitude(self):
        offboard = Offboard(self.system)
        offboard.set_attitude(Attitude(0.0, 0.0, 10.0, 0.0))
        offboard.start()
        self.wait_for_heading("attitude", 10.0, 3.0)
        offboard.stop()
        wait(lambda: self.telemetry.flight_mode().name == "HOLD", "mode HOLD again")

    def go_to(self):
        """Go to a position so far away that the bearing stays at 30 degrees."""
        here = self.telemetry.position()
        north_deg = FAR_M * math.cos(math.radians(30.0)) / METRES_PER_DEGREE
        east_deg = FAR_M * math.sin(math.radians(30.0)) / METRES_PER_DEGREE / math.cos(math.radians(here.latitude_deg))
        self.action.goto_location(here.latitude_deg + north_deg, here.longitude_deg + east_deg, 0.0, math.nan)
        self.wait_for_heading("goto", 30.0, 8.0)  # the estimated drift after a fast turn decays slowly
        self.results["last_position"] = public(self.telemetry.position())

    def wait_for_heading(self, name, goal_deg, tolerance_deg):
        """Wait until the heading has been near the goal for a second."""
        since_s = time.monotonic()

        def is_settled():
            nonlocal since_s
            if abs(math.remainder(self.telemetry.heading().heading_deg - goal_deg, 360.0)) < tolerance_deg:
                return time.monotonic() - since_s > 1.0
            since_s = time.monotonic()
            return False

        wait(is_settled, f"heading {goal_deg:g} deg by {name}")
        self.results[name] = [self.telemetry.heading().heading_deg, self.telemetry.flight_mode().name]


def main():
    url, result_file = sys.argv[1:]
    with autopilot(url) as system:
        session = Session(system)
        for step in (
            session.identify,
            session.read_telemetry,
            session.set_parameters,
            session.set_extended_parameters,
            session.arm,
            session.hold,
            session.steer_by_attitude,
            session.go_to,
        ):
            print(f"step {step.__name__}", flush=True)
            step()
        Path(result_file).write_text(json.dumps(session.results, indent=1))


if __name__ == "__main__":
    main()
