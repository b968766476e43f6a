"""A client written with MAVSDK that moves plans to and fro, run as a process of its own.

    python mavsdk_missions.py URL PLAN RESULTS.json

PLAN is a .plan of QGroundControl, which MAVSDK reads too. MAVSDK's library writes to standard
output from threads of its own, so the results go to a file. Exit code 77 says that MAVSDK
cannot be had on this machine.
"""

import json
import sys
import time
from pathlib import Path

# First: it ends the process with 77 where MAVSDK cannot be had.
from mavsdk_system import autopilot, wait

# isort: split
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw

ITEMS = 500


def mission(count):
    """Home and waypoints in a row, with numbers that tell them apart."""
    return [
        MissionItem(
            seq=index,
            frame=0 if index == 0 else 6,
            command=16,
            current=int(index == 0),
            autocontinue=1,
            param1=float(index % 7),
            param2=0.25 * (index % 11),
            x=360_000_000 + 1_000 * index,
            y=1_210_000_000 - 700 * index,
            z=float(index % 3),
        )
        for index in range(1 + count)
    ]


def fields(item):
    names = ("seq", "frame", "command", "autocontinue", "param1", "param2", "param3", "param4", "x", "y", "z")
    return [repr(getattr(item, name)) for name in (*names, "mission_type")]


def timed(call, *arguments):
    begun_s = time.monotonic()
    result = call(*arguments)
    return result, time.monotonic() - begun_s


def move_plans(missions, plan_file, seen):
    sent = mission(ITEMS)
    _, seen["upload_s"] = timed(missions.upload_mission, sent)
    got, seen["download_s"] = timed(missions.download_mission)
    seen["sent"], seen["got"] = [fields(item) for item in sent], [fields(item) for item in got]
    wait(lambda: seen["progress"], "the progress of the mission")
    seen["total"] = missions.mission_progress().total
    imported = missions.import_qgroundcontrol_mission(str(plan_file))
    missions.upload_geofence(imported.geofence_items)
    missions.upload_rally_points(imported.rally_items)
    seen["fence_sent"] = [fields(item) for item in imported.geofence_items]
    seen["rally_sent"] = [fields(item) for item in imported.rally_items]
    seen["fence_got"] = [fields(item) for item in missions.download_geofence()]
    seen["rally_got"] = [fields(item) for item in missions.download_rallypoints()]
    bad = mission(3)
    bad[2].command = 21
    try:
        missions.upload_mission(bad)
        seen["bad"] = "SUCCESS"
    except MavsdkError as error:
        seen["bad"] = error.result.name
    seen["after_bad"] = len(missions.download_mission())
    missions.clear_mission()
    seen["after_clear"] = len(missions.download_mission())


def main():
    url, plan_file, results = sys.argv[1:]
    with autopilot(url) as system:
        missions = MissionRaw(system)
        seen = {"progress": []}
        handle = missions.subscribe_mission_progress(lambda progress, _: seen["progress"].append(progress.current))
        move_plans(missions, plan_file, seen)
        missions.unsubscribe_mission_progress(handle)
        Path(results).write_text(json.dumps(seen, indent=1))


if __name__ == "__main__":
    main()
