"""The fixed-rate loop: watchdogs are served while no part is stuck."""

import pytest

from firmware_py.common.intents import Arm, Request
from firmware_py.common.records import Progress
from firmware_py.core.liveness import StuckError
from support.loop_parts import make_boat, run_for, set_parameter

STORE, LINK, LOG = (Progress(name, has_work=False, done=0) for name in ("store", "link", "log"))


class FakeWatchdogs:
    """Watchdogs that record when they are served."""

    def __init__(self):
        self.can_restart, self.calls = True, []

    def notify_alive(self, now_s, status=""):
        self.calls.append((now_s, status))


class FakeLine:
    """An open port; `written` are the bytes sent to the servo."""

    written = 0

    def reopen(self, _now_s):
        return ""


@pytest.fixture
def boat():
    parts = make_boat()
    set_parameter(parts, "LOOP_LOCK", 0)
    set_parameter(parts, "LOOP_RATE_HZ", 2)
    parts.watchdogs = FakeWatchdogs()
    parts.lines = [FakeLine()]
    parts.store.progress, parts.link.progress, parts.recorder.progress = (
        lambda: STORE,
        lambda: [LINK],
        lambda: [LOG],
    )
    return parts


def test_watchdogs_are_served_once_a_second_with_the_mode(boat):
    run_for(boat, 2.5)
    calls = [(now_s, status) for now_s, status in boat.watchdogs.calls if status]
    assert calls == [(0.0, "HOLD, disarmed"), (1.0, "HOLD, disarmed"), (2.0, "HOLD, disarmed")]
    boat.autopilot.decide(Request(2.0, Arm(armed=True, force=True)))
    run_for(boat, 1.5)
    assert boat.watchdogs.calls[-2][1] == "HOLD, armed"


@pytest.mark.parametrize("part", ["store", "link", "recorder"])
@pytest.mark.parametrize(
    ("progress", "text", "end_s"),
    [
        (Progress("writer", has_work=True, done=1), "writer: no progress for 15 s", 16.0),
        (Progress("writer", has_work=True, done=5, alive=False), "writer: has ended", 0.0),
    ],
)
def test_part_that_is_stuck_ends_the_loop_with_a_centred_rudder(boat, part, progress, text, end_s):
    getattr(boat, part).progress = lambda: progress if part == "store" else [progress]
    with pytest.raises(StuckError, match=f"^{text}$"):
        run_for(boat, 30.0)
    assert boat.recorder.ticks[-1][0].tick.t_s == end_s
    assert boat.rudder.commands[-1][1].shaft_rad == 0.0


def test_stuck_part_does_not_end_the_loop_if_nothing_restarts_the_process(boat):
    boat.watchdogs.can_restart = False
    boat.store.progress = lambda: Progress("store", has_work=True, done=5, alive=False)
    run_for(boat, 2.0)
    assert not [status for _, status in boat.watchdogs.calls if status]


def test_thread_that_waits_for_the_disk_is_reported_and_steering_continues(boat, monkeypatch):
    monkeypatch.setattr("firmware_py.loop.is_in_uninterruptible_wait", lambda thread: thread == 77)
    boat.store.progress = lambda: Progress("store", has_work=boat.clock.t_s < 20.0, done=5, thread=77)
    boat.link.progress = lambda: [Progress("link", has_work=boat.clock.t_s < 20.0, done=5, thread=77)]
    run_for(boat, 18.0)
    assert boat.health.blocked_threads == "store, link"
    run_for(boat, 4.0)
    assert boat.health.blocked_threads == ""
    boat.store.progress = lambda: Progress("store", has_work=True, done=5, alive=False, thread=78)
    with pytest.raises(StuckError, match=r"^store: has ended$"):
        run_for(boat, 4.0)


def test_sensors_and_servo_without_progress_for_half_a_minute_end_the_loop(boat):
    boat.rudder.descriptor, boat.lines[0].written = 11, 100
    with pytest.raises(StuckError, match=r"^actuation: no progress for 30 s$"):
        run_for(boat, 60.0)
    assert boat.recorder.ticks[-1][0].tick.t_s == 31.0
    boat.rudder.descriptor = -1  # a closed port is no reason
    run_for(boat, 40.0)
    boat.compass.receive = lambda _now_s: None
    boat.rudder.poll = list
    with pytest.raises(StuckError, match=r"^samples: no progress for 30 s$"):
        run_for(boat, 60.0)
