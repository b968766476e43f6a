"""A client written with MAVSDK, as a separate process: it runs a mission.

    python mavsdk_voyage.py URL RESULTS.json

The library of MAVSDK writes to standard output from its own threads, so the results go to a file. Exit code 77: MAVSDK
is not usable on this machine.
"""

import json
import math
import sys
from pathlib import Path

# First: it ends the process with code 77 if MAVSDK is not usable.
from mavsdk_system import METRES_PER_DEGREE, autopilot, wait

# isort: split
from mavsdk.plugins.action import Action
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw
from mavsdk.plugins.telemetry import Telemetry

CORNERS = ((20.0, 0.0), (20.0, 15.0))  # metres north and east of home
WAYPOINT, RETURN = 16, 20


def item(sequence, command, position=(0, 0), radius_m=0.0):
    x, y = position
    return MissionItem(
        seq=sequence, frame=6, command=command, current=int(sequence == 0), autocontinue=1, param1=0.0,
        param2=radius_m, param3=0.0, param4=0.0, x=x, y=y, z=0.0, mission_type=0,
    )  # fmt: skip


def mission(home):
    """Return a mission of home, the corners, and a return to home."""
    metres_per_degree_east = METRES_PER_DEGREE * math.cos(math.radians(home.latitude_deg))
    positions = [
        (
            round((home.latitude_deg + north_m / METRES_PER_DEGREE) * 1e7),
            round((home.longitude_deg + east_m / metres_per_degree_east) * 1e7),
        )
        for north_m, east_m in ((0.0, 0.0), *CORNERS)
    ]
    items = [item(number, WAYPOINT, position, 3.0) for number, position in enumerate(positions)]
    return [*items, item(len(items), RETURN)]


def run_mission(system, results):
    telemetry, action, missions = Telemetry(system), Action(system), MissionRaw(system)
    wait(telemetry.health_all_ok, "health_all_ok")
    wait(lambda: math.isfinite(telemetry.home().latitude_deg), "a home")
    items = mission(telemetry.home())
    missions.upload_mission(items)
    progress = results["progress"] = []

    def note_progress(state, _):
        if not progress or progress[-1] != state.current:
            progress.append(state.current)

    handle = missions.subscribe_mission_progress(note_progress)
    missions.start_mission()
    wait(lambda: telemetry.flight_mode().name == "MISSION", "mode MISSION")
    wait(lambda: 2 in progress, "the second corner")
    missions.pause_mission()
    wait(lambda: telemetry.flight_mode().name == "HOLD", "mode HOLD")
    missions.start_mission()
    wait(lambda: telemetry.flight_mode().name == "MISSION", "mode MISSION again")
    wait(lambda: 3 in progress, "the way home")
    missions.unsubscribe_mission_progress(handle)
    action.return_to_launch()
    wait(lambda: telemetry.flight_mode().name == "RETURN_TO_LAUNCH", "mode RTL")


def main():
    url, result_file = sys.argv[1:]
    with autopilot(url) as system:
        results = {}
        run_mission(system, results)
        Path(result_file).write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
