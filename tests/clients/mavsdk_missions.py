"""A client written with MAVSDK, as a separate process: it uploads and downloads plans.

    python mavsdk_missions.py URL PLAN RESULTS.json

PLAN is a plan file of QGroundControl, which MAVSDK also reads. The library of MAVSDK writes to standard output from its
own threads, so the results go to a file. Exit code 77: MAVSDK is not usable on this machine.
"""

import json
import sys
import time
from pathlib import Path

# First: it ends the process with code 77 if MAVSDK is not usable.
from mavsdk_system import autopilot, wait

# isort: split
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw

ITEMS = 500


def mission(count):
    """Return home and `count` waypoints in a row, all different."""
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
    """Return the fields of an item as text, which compares NaN as equal."""
    names = ("seq", "frame", "command", "autocontinue", "param1", "param2", "param3", "param4", "x", "y", "z")
    return [repr(getattr(item, name)) for name in (*names, "mission_type")]


def timed(call, *arguments):
    """Return the result of a call and its duration in seconds."""
    start_s = time.monotonic()
    result = call(*arguments)
    return result, time.monotonic() - start_s


def transfer_plans(missions, plan_file, results):
    sent = mission(ITEMS)
    _, results["upload_s"] = timed(missions.upload_mission, sent)
    received, results["download_s"] = timed(missions.download_mission)
    results["sent"], results["got"] = [fields(item) for item in sent], [fields(item) for item in received]
    wait(lambda: results["progress"], "the progress of the mission")
    results["total"] = missions.mission_progress().total
    imported = missions.import_qgroundcontrol_mission(str(plan_file))
    missions.upload_geofence(imported.geofence_items)
    missions.upload_rally_points(imported.rally_items)
    results["fence_sent"] = [fields(item) for item in imported.geofence_items]
    results["rally_sent"] = [fields(item) for item in imported.rally_items]
    results["fence_got"] = [fields(item) for item in missions.download_geofence()]
    results["rally_got"] = [fields(item) for item in missions.download_rallypoints()]
    invalid = mission(3)
    invalid[2].command = 21
    try:
        missions.upload_mission(invalid)
        results["bad"] = "SUCCESS"
    except MavsdkError as error:
        results["bad"] = error.result.name
    results["after_bad"] = len(missions.download_mission())
    missions.clear_mission()
    results["after_clear"] = len(missions.download_mission())


def main():
    url, plan_file, result_file = sys.argv[1:]
    with autopilot(url) as system:
        missions = MissionRaw(system)
        results = {"progress": []}
        handle = missions.subscribe_mission_progress(lambda progress, _: results["progress"].append(progress.current))
        transfer_plans(missions, plan_file, results)
        missions.unsubscribe_mission_progress(handle)
        Path(result_file).write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
