"""Parts of the autopilot that are stuck, according to their progress."""

from firmware_py.common.records import Progress
from firmware_py.core.liveness import Liveness, devices_progress

DEVICES_S = 30.0


def stuck_names(liveness, now_s, *parts):
    return [part.name for part in liveness.update(parts, now_s)]


def test_part_with_work_and_without_progress_is_stuck_after_its_timeout():
    liveness = Liveness()
    for now_s, done, names in (
        (0.0, 3, []), (15.0, 3, []), (15.1, 3, ["store"]), (15.2, 4, []), (30.2, 4, []), (30.3, 4, ["store"]),
    ):  # fmt: skip
        assert stuck_names(liveness, now_s, Progress("store", True, done), Progress("log", True, round(now_s))) == names


def test_part_without_work_is_never_stuck_and_its_time_starts_with_the_work():
    liveness = Liveness()
    for now_s in range(0, 1000, 100):
        assert stuck_names(liveness, float(now_s), Progress("store", False, 3)) == []
    assert stuck_names(liveness, 910.0, Progress("store", True, 3)) == []
    assert stuck_names(liveness, 915.1, Progress("store", True, 3)) == ["store"]


def test_ended_thread_is_stuck_at_once():
    assert stuck_names(Liveness(), 0.0, Progress("log", True, 3, alive=False)) == ["log"]


def test_missing_devices_are_not_stuck():
    liveness = Liveness()
    for now_s in (0.0, 2.0 * DEVICES_S):
        devices = devices_progress(0, 0, [True], rudder_connected=True)
        assert stuck_names(liveness, now_s, *devices) == []
    for now_s in (3.0 * DEVICES_S, 5.0 * DEVICES_S):
        devices = devices_progress(7, 100, [False, False], rudder_connected=False)
        assert stuck_names(liveness, now_s, *devices) == []


def test_devices_without_samples_or_servo_output_are_stuck():
    liveness = Liveness()
    assert stuck_names(liveness, 0.0, *devices_progress(7, 100, [True, False], rudder_connected=True)) == []
    later_s = DEVICES_S + 0.1
    assert stuck_names(liveness, later_s, *devices_progress(8, 100, [True], rudder_connected=True)) == ["actuation"]
    assert stuck_names(liveness, 2 * later_s, *devices_progress(8, 200, [True], rudder_connected=True)) == ["samples"]
