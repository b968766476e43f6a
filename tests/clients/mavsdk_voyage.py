"""A client written with MAVSDK that runs a mission, run as a process of its own.

    python mavsdk_voyage.py URL RESULTS.json

MAVSDK's library writes to standard output from threads of its own, so the results go to a
file. Exit code 77 says that MAVSDK cannot be had on this machine.
"""

import json
import math
import sys
from pathlib import Path

# First: it ends the process with 77 where MAVSDK cannot be had.
from mavsdk_system import METRES_PER_DEGREE, autopilot, wait

# isort: split
from mavsdk.plugins.action import Action
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw
from mavsdk.plugins.telemetry import Telemetry

CORNERS = ((20.0, 0.0), (20.0, 15.0))  # metres north and east of home
WAYPOINT, RETURN = 16, 20


def item(sequence, command, place=(0, 0), radius_m=0.0):
    x, y = place
    return MissionItem(
        seq=sequence, frame=6, command=command, current=int(sequence == 0), autocontinue=1, param1=0.0,
        param2=radius_m, param3=0.0, param4=0.0, x=x, y=y, z=0.0, mission_type=0,
    )  # fmt: skip


def mission(home):
    """Home, the corners, and back."""
    east = METRES_PER_DEGREE * math.cos(math.radians(home.latitude_deg))
    places = [
        (
            round((home.latitude_deg + north_m / METRES_PER_DEGREE) * 1e7),
            round((home.longitude_deg + east_m / east) * 1e7),
        )
        for north_m, east_m in ((0.0, 0.0), *CORNERS)
    ]
    items = [item(number, WAYPOINT, place, 3.0) for number, place in enumerate(places)]
    return [*items, item(len(items), RETURN)]


def sail(system, seen):
    telemetry, action, missions = Telemetry(system), Action(system), MissionRaw(system)
    wait(telemetry.health_all_ok, "health_all_ok")
    wait(lambda: math.isfinite(telemetry.home().latitude_deg), "a home")
    items = mission(telemetry.home())
    missions.upload_mission(items)
    progress = seen["progress"] = []

    def note(state, _):
        if not progress or progress[-1] != state.current:
            progress.append(state.current)

    handle = missions.subscribe_mission_progress(note)
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
    url, results = sys.argv[1:]
    with autopilot(url) as system:
        seen = {}
        sail(system, seen)
        Path(results).write_text(json.dumps(seen, indent=1))


if __name__ == "__main__":
    main()
