"""Execution of missions: the task of each item, and its end."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.reports import MissionState
from firmware_py.guidance import mission, mission_progress
from firmware_py.guidance.mission import MissionInput
from firmware_py.guidance.mission_commands import next_utc_of
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.guidance.mission_step import MissionStep
from firmware_py.guidance.orbit import OrbitState
from firmware_py.guidance.task_follower import TaskFollowerState
from firmware_py.guidance.tasks import GoTo, HoldHeading, HoldStation, Orbit, TaskSettings, VesselMotion
from firmware_py.plans.items import TABLE, Command

SETTINGS = TaskSettings(acceptance_radius_m=20.0, station_radius_m=100.0, look_ahead_s=60.0, turning_radius_m=15.6)
HERE = Place(0.6, 2.0)
A, B, C = HERE.at_offset(500.0, 0.0), HERE.at_offset(500.0, 500.0), HERE.at_offset(0.0, 500.0)


def waypoint(place, **fields):
    return MissionStep(Command.WAYPOINT, place, **fields)


def jump(target, times):
    return MissionStep(Command.JUMP, target=target, times=times)


def go_to(place, start=None, acceptance_m=20.0, station_m=100.0):
    return GoTo(place, start, acceptance_m, station_m)


class MissionRunner:
    """Executes a list of steps; the test decides when the boat has arrived."""

    def __init__(self, *steps, place=HERE, heading_rad=0.0):
        self.steps = steps
        self.progress = mission_progress.enter(MissionProgress(identity=1))
        self.motion = VesselMotion(place, heading_rad, 0.4, 0.0, 0.0)
        self.return_task = GoTo(HERE, None, 20.0, 100.0)
        self.utc_s = None
        self.reached = []
        self.home = None
        self.fence = None

    def step(self, *, arrived=False, turned_rad=0.0, step_s=1.0, has_position=True, spread_m=0.0):
        follower = TaskFollowerState(self.progress.task, arrived, orbit=OrbitState(0.0, turned_rad))
        mission_input = MissionInput(
            SETTINGS,
            self.steps,
            self.motion.heading_rad,
            self.motion.place if has_position else None,
            follower,
            step_s,
            self.utc_s,
            lambda _present: self.return_task,
            spread_m,
        )
        output = mission.update(self.progress, mission_input)
        self.progress = output.progress
        self.reached += output.reached
        self.home = output.home or self.home
        self.fence = output.fence_enabled if output.fence_enabled is not None else self.fence
        return self.progress.task

    def steps_with(self, count, **state):
        """Run several steps; return the last task."""
        return [self.step(**state) for _ in range(count)][-1]

    def state(self, count=2):
        return mission_progress.state_of(self.progress, count, running=True)


def test_boat_follows_lines_between_waypoints_and_keeps_station_at_the_last():
    runner = MissionRunner(waypoint(A), waypoint(B, radius_m=5.0))
    assert [runner.step(), runner.step()] == [go_to(A)] * 2
    assert [runner.step(arrived=True) for _ in range(2)] == [go_to(B, A, 5.0)] * 2
    assert (runner.progress.complete, runner.progress.index) == (True, 1)
    assert runner.reached == [0, 1]
    assert runner.state() is MissionState.COMPLETE


def test_arrival_at_one_item_does_not_end_the_next():
    runner = MissionRunner(waypoint(A), waypoint(B), waypoint(C))
    runner.step()
    runner.step(arrived=True)
    assert runner.progress.index == 1


@pytest.mark.parametrize(
    "state", [{}, {"arrived": True, "has_position": False}, {"arrived": True, "spread_m": 100.1}], ids=str
)
def test_hold_time_starts_at_a_certain_arrival(state):
    runner = MissionRunner(waypoint(A, seconds=10.0), waypoint(B))
    runner.step()
    assert runner.steps_with(50, **state).place == A
    assert runner.progress.elapsed_s == 0.0
    assert runner.steps_with(9, arrived=True, spread_m=100.0).place == A
    assert runner.step(arrived=True).place == B


def test_items_after_a_distance_condition_are_executed_on_the_way():
    near = MissionStep(Command.CONDITION_DISTANCE, A, distance_m=120.0)
    runner = MissionRunner(waypoint(C), near, MissionStep(Command.FENCE_ENABLE, enabled=True), waypoint(A))
    runner.step()
    assert runner.step(arrived=True) == go_to(A, C)  # the same line as the waypoint A
    assert (runner.progress.index, runner.fence) == (1, None)
    runner.motion = replace(runner.motion, place=A.at_offset(0.0, 119.0))
    assert runner.step() == go_to(A, C)
    assert (runner.progress.index, runner.fence) == (3, True)


@pytest.mark.parametrize(("spread_m", "index"), [(120.1, 0), (120.0, 1)])
def test_distance_condition_needs_a_smaller_position_error(spread_m, index):
    near = MissionStep(Command.CONDITION_DISTANCE, A, distance_m=120.0)
    runner = MissionRunner(near, waypoint(A), place=A.at_offset(0.0, 100.0))
    runner.step(spread_m=spread_m)
    assert runner.progress.index == index


def test_distance_condition_ends_at_the_arrival():
    near = MissionStep(Command.CONDITION_DISTANCE, A, distance_m=1.0)
    runner = MissionRunner(near, MissionStep(Command.CONDITION_DELAY, seconds=3.0), waypoint(A))
    runner.step()
    runner.step(arrived=True)
    assert runner.progress.index == 1
    runner.steps_with(2)
    assert runner.progress.index == 2


def test_loiter_items_keep_station_or_circle():
    turns = MissionStep(Command.LOITER_TURNS, B, None, turns=2.0, clockwise=False)
    loiter_time = MissionStep(Command.LOITER_TIME, A, 40.0, 5.0)
    runner = MissionRunner(loiter_time, turns, turns, MissionStep(Command.LOITER_UNLIMITED, C), waypoint(A))
    assert runner.step() == go_to(A, station_m=40.0)
    assert runner.steps_with(4, arrived=True).station_radius_m == 40.0
    orbit = runner.step(arrived=True)
    assert orbit == replace(Orbit(B, 100.0, clockwise=False), number=orbit.number)
    assert runner.step(arrived=True, turned_rad=12.5) == orbit
    next_orbit = runner.step(arrived=True, turned_rad=4 * math.pi + 0.01)
    assert next_orbit != orbit  # a new task, whose turns start at 0
    assert runner.step(arrived=True, turned_rad=13.0) == go_to(C, B)
    assert runner.steps_with(100, arrived=True, step_s=1e6).place == C


def test_return_goes_to_the_destination_or_keeps_station():
    runner = MissionRunner(MissionStep(Command.RETURN), waypoint(A))
    assert runner.step() == runner.return_task
    assert runner.step(arrived=True) == go_to(A, HERE)
    without_home = MissionRunner(MissionStep(Command.RETURN))
    without_home.return_task = None
    assert without_home.step() == HoldStation(HERE, 100.0)


@pytest.mark.parametrize("kind", [Command.YAW, Command.YAW_SPEED])
def test_heading_is_kept_during_a_following_delay(kind):
    delay = MissionStep(Command.DELAY, seconds=30.0)
    runner = MissionRunner(MissionStep(kind, angle_rad=1.0, relative=True), delay, waypoint(A))
    runner.motion = replace(runner.motion, heading_rad=6.0)
    assert [runner.step(), runner.step()] == [HoldHeading((1.0 + 6.0) % (2 * math.pi))] * 2
    runner.motion = replace(runner.motion, heading_rad=0.75)
    assert isinstance(runner.steps_with(29), HoldHeading)
    assert runner.progress.index == 1
    assert runner.steps_with(2) == go_to(A)  # a heading has no place: no line


@pytest.mark.parametrize(("off_deg", "index"), [(4.9, 1), (5.1, 0), (-4.9, 1), (-5.1, 0)])
def test_heading_item_ends_within_five_degrees(off_deg, index):
    runner = MissionRunner(
        MissionStep(Command.YAW, angle_rad=1.0), waypoint(A), heading_rad=1.0 + math.radians(off_deg)
    )
    runner.step()
    assert runner.progress.index == index


def test_heading_item_ends_after_ten_minutes():
    runner = MissionRunner(MissionStep(Command.YAW, angle_rad=1.0), waypoint(A))
    runner.steps_with(599)
    assert runner.progress.index == 0
    runner.steps_with(2)
    assert runner.progress.index == 1


@pytest.mark.parametrize("set_back_s", [0.0, 86400.0 * 7000])
def test_delay_ends_at_a_time_of_day(set_back_s):
    """The end is recomputed if the clock is set back."""
    runner = MissionRunner(waypoint(A), MissionStep(Command.DELAY, time_of_day_s=100.0), waypoint(B))
    runner.utc_s = 86400.0 * 20000 + 90.0
    runner.step()
    assert runner.step(arrived=True) == go_to(A)
    runner.utc_s -= set_back_s
    for _ in range(9):
        runner.utc_s += 1.0
        runner.step(arrived=True)
        assert runner.progress.index == 1
    runner.utc_s += 1.0
    assert runner.step(arrived=True) == go_to(B, A)


DAY_S = 86_400.0


@pytest.mark.parametrize(
    ("until_utc_s", "elapsed_s", "utc_s", "expected_s"),
    [
        (None, 10.0, 2.0 * DAY_S + 50.0, 2.0 * DAY_S + 100.0),
        (None, 100.0, 2.0 * DAY_S + 150.0, 2.0 * DAY_S + 100.0),  # it has passed since the beginning
        (None, 10.0, 2.0 * DAY_S + 150.0, 3.0 * DAY_S + 100.0),
        (9.0 * DAY_S, 10.0, 10.0 * DAY_S, 9.0 * DAY_S),  # it has passed during an interruption
        (9.0 * DAY_S, 10.0, 8.0 * DAY_S, 9.0 * DAY_S),
        (9.0 * DAY_S, 10.0, 8.0 * DAY_S - 1.0, 8.0 * DAY_S - 11.0 + 111.0),  # the clock was set back
    ],
)
def test_end_of_a_delay_is_the_next_time_of_day_after_its_beginning(until_utc_s, elapsed_s, utc_s, expected_s):
    progress = MissionProgress(elapsed_s=elapsed_s, until_utc_s=until_utc_s)
    assert next_utc_of(100.0, utc_s, progress) == expected_s


def test_delay_until_a_time_of_day_lasts_a_day_without_a_clock():
    runner = MissionRunner(MissionStep(Command.DELAY, time_of_day_s=100.0), waypoint(A))
    runner.utc_s = 50.0
    runner.step(step_s=0.5)
    runner.utc_s = None
    runner.step(step_s=86_399.0)
    assert runner.progress.index == 0
    assert runner.step(step_s=0.5) == go_to(A)


def test_limited_jump_is_executed_twice():
    runner = MissionRunner(waypoint(A), waypoint(B), jump(0, 2), waypoint(C))
    places = [runner.step().place, *(runner.step(arrived=True).place for _ in range(6))]
    assert places == [A, B, A, B, A, B, C]


def test_unlimited_jump_does_not_end_the_mission():
    runner = MissionRunner(waypoint(A), waypoint(B), jump(0, -1))
    for _ in range(100):
        runner.step(arrived=True)
        runner.step()
    assert not runner.progress.complete


@pytest.mark.parametrize(
    ("steps", "count"), [((), 0), ((MissionStep(Command.CHANGE_SPEED), jump(0, -1)), 103)], ids=["empty", "endless"]
)
def test_boat_keeps_station_in_an_unusable_mission(steps, count):
    runner = MissionRunner(*steps)
    assert runner.steps_with(20) == HoldStation(HERE, 100.0)
    assert runner.progress.unusable
    assert len(runner.reached) == count  # an endless mission ends after 100 more items than it has
    assert mission_progress.state_of(runner.progress, 0, running=True) is MissionState.NO_MISSION


def test_sixteen_items_without_duration_are_executed_in_a_step():
    runner = MissionRunner(*[MissionStep(Command.CHANGE_SPEED)] * 20, waypoint(A))
    runner.step()
    assert len(runner.reached) == 16
    assert runner.step() == go_to(A)


def test_limited_jumps_over_items_without_duration_end():
    speed = MissionStep(Command.CHANGE_SPEED)
    runner = MissionRunner(waypoint(A), speed, jump(1, 300), jump(2, 3), jump(0, 1), waypoint(B))
    runner.step()
    places = []
    for _ in range(2):
        runner.step(arrived=True)
        places.append(runner.steps_with(60).place)
    assert places == [A, B]
    assert not runner.progress.unusable
    assert runner.reached.count(1) == 301 + 1


def test_home_is_set_to_a_place_or_to_a_position_with_a_fix():
    runner = MissionRunner(MissionStep(Command.SET_HOME, B), MissionStep(Command.CHANGE_SPEED), waypoint(A))
    assert runner.step().place == A
    assert (runner.home, runner.reached) == (B, [0, 1])
    at_position = MissionRunner(MissionStep(Command.SET_HOME), MissionStep(None), waypoint(A))
    at_position.step(spread_m=1.0)
    assert (at_position.home, at_position.progress.index) == (None, 0)
    at_position.step()
    assert (at_position.home, at_position.progress.index) == (HERE, 2)


def test_item_without_autocontinue_pauses_the_mission():
    runner = MissionRunner(waypoint(A, autocontinue=False), waypoint(B))
    assert runner.steps_with(20, arrived=True).place == A
    assert (runner.reached, runner.state()) == ([0], MissionState.PAUSED)
    runner.progress = mission_progress.enter(runner.progress)  # by arming, or at the end of a failsafe
    assert runner.step(arrived=True).place == A
    assert runner.state() is MissionState.PAUSED
    runner.progress = mission_progress.resume_mission(runner.progress, runner.steps)
    assert runner.step().place == B
    assert runner.state() is MissionState.ACTIVE
    assert mission_progress.resume_mission(runner.progress, runner.steps) is runner.progress


def test_boat_keeps_station_at_the_place_of_the_pause():
    runner = MissionRunner(waypoint(A), waypoint(B))
    task = runner.step()
    runner.progress = mission_progress.pause(runner.progress)
    for place in (C, A):
        runner.motion = replace(runner.motion, place=place)
        runner.step()
    assert runner.progress.pause_task == HoldStation(C, 100.0)
    assert runner.state() is MissionState.PAUSED
    runner.progress = mission_progress.resume_mission(runner.progress, runner.steps)
    assert runner.step() == task


def test_commanded_item_has_no_line_and_a_restart_resets_jumps():
    runner = MissionRunner(waypoint(A), jump(0, 1), waypoint(B))
    runner.step()
    runner.step(arrived=True)
    assert runner.progress.jumps == ((1, 1),)
    runner.progress = mission_progress.at_item(runner.progress, 2, restart=False)
    assert runner.step() == go_to(B)
    assert runner.progress.jumps
    assert mission_progress.at_item(runner.progress, 0, restart=True).jumps == ()


def test_progress_of_an_item_is_not_that_of_the_next():
    present = MissionProgress(
        identity=1,
        index=3,
        started=True,
        begun=True,
        waiting=True,
        complete=True,
        unusable=True,
        elapsed_s=5.0,
        until_utc_s=9.0,
        idle_items=2,
        orbits=4,
        jumps=((1, 1),),
        line_start=A,
        task=go_to(B),
    )
    kept = {"identity": 1, "started": True, "orbits": 4, "task": go_to(B)}
    commanded = MissionProgress(index=2, jumps=((1, 1),), **kept)
    assert mission_progress.at_item(present, 2, restart=False) == commanded
    assert mission_progress.at_item(present, 2, restart=True) == replace(commanded, jumps=())
    finished = replace(present, begun=False, waiting=False, elapsed_s=0.0, until_utc_s=None)
    for step, changes in (
        (waypoint(C), {"index": 4, "idle_items": 3}),
        (jump(0, 1), {"index": 0, "jumps": ((1, 1), (3, 1)), "idle_items": 0}),
        (jump(0, -1), {"index": 0, "jumps": ((1, 1), (3, 1)), "idle_items": 3}),
        (jump(0, 0), {"index": 4, "idle_items": 3}),
        (jump(-1, 1), {"index": 4, "idle_items": 3}),
    ):
        assert mission_progress.after_item(present, step) == replace(finished, **changes)
    assert mission_progress.enter(replace(present, complete=False, unusable=False)) == replace(
        present, complete=False, unusable=False, line_start=None
    )
    assert mission_progress.enter(present) == MissionProgress(identity=1, started=True)


def test_change_to_auto_continues_the_item_and_restarts_a_complete_mission():
    runner = MissionRunner(waypoint(A), waypoint(B))
    runner.step()
    runner.step(arrived=True)
    runner.progress = mission_progress.enter(runner.progress)
    assert runner.step() == go_to(B)
    runner.step(arrived=True)
    assert runner.progress.complete
    runner.progress = mission_progress.enter(runner.progress)
    assert runner.step() == go_to(A)


def test_new_mission_begins_at_its_first_item():
    progress = MissionProgress(identity=1, index=5, jumps=((1, 1),), started=True)
    assert mission_progress.for_plan(progress, 1) is progress
    assert mission_progress.for_plan(progress, 2) == MissionProgress(identity=2)
    assert mission_progress.state_of(MissionProgress(), 3, running=False) is MissionState.NOT_STARTED
    assert mission_progress.state_of(progress, 6, running=False) is MissionState.PAUSED


def test_headings_and_delays_need_no_position():
    turn = MissionStep(Command.YAW, angle_rad=1.0)
    runner = MissionRunner(turn, MissionStep(Command.DELAY, seconds=30.0), jump(0, 1), waypoint(A))
    assert runner.step(has_position=False) == HoldHeading(1.0)
    runner.motion = replace(runner.motion, heading_rad=1.0)
    runner.steps_with(62, has_position=False)
    assert runner.reached == [0, 1, 2, 0, 1, 2]
    assert runner.step(has_position=False) == go_to(A)  # the place of the item is known


@pytest.mark.parametrize(
    "step",
    [
        waypoint(None),
        MissionStep(Command.LOITER_TURNS),
        MissionStep(Command.RETURN),
        MissionStep(Command.DELAY, seconds=5.0),
        MissionStep(Command.SET_HOME),
    ],
)
def test_item_at_the_present_position_waits_for_a_position(step):
    runner = MissionRunner(step, waypoint(A))
    assert runner.step(has_position=False) is None
    assert (runner.progress.index, runner.progress.begun, runner.progress.complete) == (0, False, False)
    assert runner.step() is not None
    assert runner.progress.begun


def test_mission_of_headings_ends_when_the_position_is_known():
    runner = MissionRunner(MissionStep(Command.YAW, angle_rad=0.0))
    assert runner.steps_with(5, has_position=False) == HoldHeading(0.0)
    assert not runner.progress.complete
    assert runner.step() == HoldStation(HERE, 100.0)
    assert runner.progress.complete


steps = st.builds(
    MissionStep,
    st.none() | st.sampled_from([row.command for row in TABLE]),
    st.none() | st.sampled_from([A, B, C]),
    st.none() | st.floats(1.0, 100.0),
    st.floats(0.0, 20.0),
    st.none() | st.floats(0.0, 86399.0),
    st.floats(0.0, 3.0),
    st.booleans(),
    st.floats(0.0, 6.28),
    st.booleans(),
    st.integers(-1, 8),
    st.integers(-1, 3),
    st.booleans(),
)


@given(st.lists(steps, max_size=6), st.lists(st.booleans(), max_size=60))
def test_task_and_index_are_valid_for_any_mission(mission_steps, arrivals):
    runner = MissionRunner(*mission_steps)
    for arrived in arrivals:
        assert runner.step(arrived=arrived, turned_rad=30.0) is not None
        assert 0 <= runner.progress.index < max(1, len(mission_steps)) or not runner.progress.begun
    assert all(0 <= index < len(mission_steps) for index in runner.reached)
