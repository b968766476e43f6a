"""What is stuck, judged by what each part has done."""

from firmware_py.common.records import Progress
from firmware_py.core.liveness import DEVICES_S, Liveness, devices_progress


def stuck(liveness, now_s, *parts):
    return [part.name for part in liveness.update(parts, now_s)]


def test_a_part_is_stuck_that_owes_and_does_nothing_for_longer_than_its_patience():
    liveness = Liveness()
    assert stuck(liveness, 0.0, Progress("store", True, 3)) == []
    assert stuck(liveness, 15.0, Progress("store", True, 3)) == []
    assert stuck(liveness, 15.1, Progress("store", True, 3), Progress("log", True, 0)) == ["store"]
    assert stuck(liveness, 15.2, Progress("store", True, 4)) == []
    assert stuck(liveness, 30.2, Progress("store", True, 4)) == []
    assert stuck(liveness, 30.3, Progress("store", True, 4)) == ["store"]


def test_who_owes_nothing_is_never_stuck_and_its_time_counts_from_when_it_does():
    liveness = Liveness()
    for now_s in range(0, 1000, 100):
        assert stuck(liveness, float(now_s), Progress("store", False, 3)) == []
    assert stuck(liveness, 910.0, Progress("store", True, 3)) == []
    assert stuck(liveness, 915.1, Progress("store", True, 3)) == ["store"]


def test_a_thread_that_has_ended_is_stuck_at_once():
    assert stuck(Liveness(), 0.0, Progress("log", True, 3, alive=False)) == ["log"]


def test_devices_that_have_never_spoken_or_are_not_there_are_no_reason():
    liveness = Liveness()
    for now_s in (0.0, 2.0 * DEVICES_S):
        never = devices_progress(0, 0, [True], rudder_connected=True)
        assert stuck(liveness, now_s, *never) == []
    for now_s in (3.0 * DEVICES_S, 5.0 * DEVICES_S):
        away = devices_progress(7, 100, [False, False], rudder_connected=False)
        assert stuck(liveness, now_s, *away) == []


def test_all_of_them_silent_at_once_or_a_servo_that_gets_nothing_is_one():
    liveness = Liveness()
    assert stuck(liveness, 0.0, *devices_progress(7, 100, [True, False], rudder_connected=True)) == []
    later_s = DEVICES_S + 0.1
    assert stuck(liveness, later_s, *devices_progress(8, 100, [True], rudder_connected=True)) == ["actuation"]
    assert stuck(liveness, 2 * later_s, *devices_progress(8, 200, [True], rudder_connected=True)) == ["samples"]
