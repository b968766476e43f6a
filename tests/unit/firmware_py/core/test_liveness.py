"""What is stuck, judged by what each part has done."""

from firmware_py.common.records import Progress
from firmware_py.core.liveness import DEVICES_S, Liveness, devices_progress


def stuck(liveness, now_s, *parts):
    return [part.name for part in liveness.update(parts, now_s)]


def test_a_part_with_work_and_no_progress_is_stuck_after_its_timeout():
    liveness = Liveness()
    assert stuck(liveness, 0.0, Progress("store", True, 3)) == []
    assert stuck(liveness, 15.0, Progress("store", True, 3)) == []
    assert stuck(liveness, 15.1, Progress("store", True, 3), Progress("log", True, 0)) == ["store"]
    assert stuck(liveness, 15.2, Progress("store", True, 4)) == []
    assert stuck(liveness, 30.2, Progress("store", True, 4)) == []
    assert stuck(liveness, 30.3, Progress("store", True, 4)) == ["store"]


def test_a_part_without_work_is_never_stuck_and_its_time_starts_with_the_work():
    liveness = Liveness()
    for now_s in range(0, 1000, 100):
        assert stuck(liveness, float(now_s), Progress("store", False, 3)) == []
    assert stuck(liveness, 910.0, Progress("store", True, 3)) == []
    assert stuck(liveness, 915.1, Progress("store", True, 3)) == ["store"]


def test_a_thread_that_has_ended_is_stuck_at_once():
    assert stuck(Liveness(), 0.0, Progress("log", True, 3, alive=False)) == ["log"]


def test_devices_that_never_sent_anything_or_are_missing_are_not_stuck():
    liveness = Liveness()
    for now_s in (0.0, 2.0 * DEVICES_S):
        never = devices_progress(0, 0, [True], rudder_connected=True)
        assert stuck(liveness, now_s, *never) == []
    for now_s in (3.0 * DEVICES_S, 5.0 * DEVICES_S):
        away = devices_progress(7, 100, [False, False], rudder_connected=False)
        assert stuck(liveness, now_s, *away) == []


def test_all_devices_silent_or_no_servo_output_is_stuck():
    liveness = Liveness()
    assert stuck(liveness, 0.0, *devices_progress(7, 100, [True, False], rudder_connected=True)) == []
    later_s = DEVICES_S + 0.1
    assert stuck(liveness, later_s, *devices_progress(8, 100, [True], rudder_connected=True)) == ["actuation"]
    assert stuck(liveness, 2 * later_s, *devices_progress(8, 200, [True], rudder_connected=True)) == ["samples"]
