"""The executor alone: what each item has her do and when it is done with."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.reports import MissionState
from firmware_py.guidance import mission, mission_progress
from firmware_py.guidance.mission import MissionInput
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.guidance.mission_step import MissionStep
from firmware_py.guidance.orbit import OrbitState
from firmware_py.guidance.task_follower import TaskFollowerState
from firmware_py.guidance.tasks import GoTo, HoldHeading, HoldStation, Orbit, TaskSettings, VesselMotion
from firmware_py.plans.items import TABLE, Command

SETTINGS = TaskSettings(acceptance_radius_m=20.0, station_radius_m=100.0, look_ahead_s=60.0, turning_radius_m=15.6)
HERE = Place(0.6, 2.0)
A, B, C = HERE.at_offset(500.0, 0.0), HERE.at_offset(500.0, 500.0), HERE.at_offset(0.0, 500.0)


def waypoint(place, **more):
    return MissionStep(Command.WAYPOINT, place, **more)


def jump(target, times):
    return MissionStep(Command.JUMP, target=target, times=times)


class Crew:
    """Sails a list of steps by saying when she has arrived."""

    def __init__(self, *steps, place=HERE, heading_rad=0.0):
        self.steps = steps
        self.progress = mission_progress.enter(MissionProgress(identity=1))
        self.motion = VesselMotion(place, heading_rad, 0.4, 0.0, 0.0)
        self.back = GoTo(HERE, None, 20.0, 100.0)
        self.utc_s = None
        self.reached = []
        self.home = None
        self.fence = None

    def resume_mission(self, *, arrived=False, turned_rad=0.0, step_s=1.0, position=True, spread_m=0.0):
        follower = TaskFollowerState(self.progress.task, arrived, orbit=OrbitState(0.0, turned_rad))
        mission_input = MissionInput(
            SETTINGS,
            self.steps,
            self.motion.heading_rad,
            self.motion.place if position else None,
            follower,
            step_s,
            self.utc_s,
            lambda _chosen: self.back,
            spread_m,
        )
        output = mission.update(self.progress, mission_input)
        self.progress = output.progress
        self.reached += output.reached
        self.home = output.home or self.home
        self.fence = output.fence_enabled if output.fence_enabled is not None else self.fence
        return self.progress.task


def test_waypoints_are_joined_by_lines_and_the_end_is_kept():
    crew = Crew(waypoint(A), waypoint(B, radius_m=5.0))
    assert crew.resume_mission() == GoTo(A, None, 20.0, 100.0)
    assert crew.resume_mission() == GoTo(A, None, 20.0, 100.0)
    assert crew.resume_mission(arrived=True) == GoTo(B, A, 5.0, 100.0)
    assert crew.resume_mission(arrived=True) == GoTo(B, A, 5.0, 100.0)  # and there she keeps station
    assert crew.progress.complete
    assert crew.reached == [0, 1]
    assert mission_progress.state_of(crew.progress, 2, running=True) is MissionState.COMPLETE


def test_what_was_reached_before_is_no_arrival_at_the_next():
    crew = Crew(waypoint(A), waypoint(B), waypoint(C))
    crew.resume_mission()
    crew.resume_mission(arrived=True)
    assert crew.progress.index == 1


def test_a_hold_time_counts_from_the_arrival():
    crew = Crew(waypoint(A, seconds=10.0), waypoint(B))
    for _ in range(50):
        crew.resume_mission()
    for _ in range(9):
        assert crew.resume_mission(arrived=True).place == A
    assert crew.resume_mission(arrived=True).place == B


def test_what_waits_for_a_distance_is_done_on_the_way_there():
    near = MissionStep(Command.CONDITION_DISTANCE, A, distance_m=120.0)
    crew = Crew(waypoint(C), near, MissionStep(Command.FENCE_ENABLE, enabled=True), waypoint(A))
    crew.resume_mission()
    assert crew.resume_mission(arrived=True) == GoTo(A, C, 20.0, 100.0)  # on the line that A's own item will go on with
    assert (crew.progress.index, crew.fence) == (1, None)
    crew.motion = replace(crew.motion, place=A.at_offset(0.0, 119.0))
    assert crew.resume_mission() == GoTo(A, C, 20.0, 100.0)
    assert (crew.progress.index, crew.fence) == (3, True)


def test_a_place_that_is_reckoned_counts_as_far_as_it_is_certain():
    near = MissionStep(Command.CONDITION_DISTANCE, A, distance_m=120.0)
    crew = Crew(near, waypoint(A), place=A.at_offset(0.0, 100.0))
    crew.resume_mission(spread_m=121.0)
    assert crew.progress.index == 0
    crew.resume_mission(spread_m=119.0)
    assert crew.progress.index == 1


def test_time_on_station_counts_while_it_is_certain_that_she_is_there():
    crew = Crew(waypoint(A, seconds=10.0), waypoint(B))
    crew.resume_mission()
    for _ in range(50):
        crew.resume_mission(arrived=True, spread_m=101.0)
    assert crew.progress.elapsed_s == 0.0
    crew.resume_mission(arrived=True, spread_m=99.0)
    assert crew.progress.elapsed_s == 1.0


def test_home_is_not_set_to_a_reckoned_place():
    crew = Crew(MissionStep(Command.SET_HOME), waypoint(A))
    crew.resume_mission(spread_m=1.0)
    assert (crew.home, crew.progress.index) == (None, 0)
    crew.resume_mission()
    assert (crew.home, crew.progress.index) == (HERE, 1)


def test_an_arrival_is_near_enough_and_a_delay_waits_where_she_is():
    near = MissionStep(Command.CONDITION_DISTANCE, A, distance_m=1.0)
    crew = Crew(near, MissionStep(Command.CONDITION_DELAY, seconds=3.0), waypoint(A))
    crew.resume_mission()
    crew.resume_mission(arrived=True)
    assert crew.progress.index == 1
    for _ in range(2):
        crew.resume_mission()
    assert crew.progress.index == 2


def test_loiter_for_a_time_for_turns_and_for_ever():
    crew = Crew(
        MissionStep(Command.LOITER_TIME, A, 40.0, 5.0),
        MissionStep(Command.LOITER_TURNS, B, None, turns=2.0, clockwise=False),
        MissionStep(Command.LOITER_TURNS, B, None, turns=2.0, clockwise=False),
        MissionStep(Command.LOITER_UNLIMITED, C),
        waypoint(A),
    )
    assert crew.resume_mission() == GoTo(A, None, 20.0, 40.0)
    for _ in range(4):
        assert crew.resume_mission(arrived=True).station_radius_m == 40.0
    first = crew.resume_mission(arrived=True)
    assert first == replace(Orbit(B, 100.0, clockwise=False), number=first.number)
    assert crew.resume_mission(arrived=True, turned_rad=12.5) == first
    second = crew.resume_mission(arrived=True, turned_rad=4 * math.pi + 0.01)
    assert second != first  # counted anew
    assert crew.resume_mission(arrived=True, turned_rad=13.0) == GoTo(C, B, 20.0, 100.0)
    for _ in range(100):
        assert crew.resume_mission(arrived=True, step_s=1e6).place == C


def test_return_goes_back_and_then_on():
    crew = Crew(MissionStep(Command.RETURN), waypoint(A))
    assert crew.resume_mission() == crew.back
    assert crew.resume_mission(arrived=True) == GoTo(A, HERE, 20.0, 100.0)


def test_return_without_a_place_keeps_station():
    crew = Crew(MissionStep(Command.RETURN))
    crew.back = None
    assert crew.resume_mission() == HoldStation(HERE, 100.0)


@pytest.mark.parametrize("kind", [Command.YAW, Command.YAW_SPEED])
def test_a_heading_is_turned_to_and_held_by_a_delay(kind):
    crew = Crew(MissionStep(kind, angle_rad=1.0, relative=True), MissionStep(Command.DELAY, seconds=30.0), waypoint(A))
    crew.motion = replace(crew.motion, heading_rad=6.0)
    assert crew.resume_mission() == HoldHeading((1.0 + 6.0) % (2 * math.pi))
    assert crew.resume_mission().heading_rad == pytest.approx(7.0 - 2 * math.pi)
    crew.motion = replace(crew.motion, heading_rad=0.75)
    for _ in range(29):
        assert isinstance(crew.resume_mission(), HoldHeading)
    assert crew.progress.index == 1
    # From where she is, because a heading leads to no place.
    crew.resume_mission()
    assert crew.resume_mission() == GoTo(A, None, 20.0, 100.0)


def test_a_heading_that_is_not_reached_is_left_after_ten_minutes():
    crew = Crew(MissionStep(Command.YAW, angle_rad=1.0), waypoint(A))
    for _ in range(601):
        crew.resume_mission()
    assert crew.progress.index == 1


def test_a_delay_elsewhere_keeps_station_and_a_time_of_day_is_waited_for():
    crew = Crew(waypoint(A), MissionStep(Command.DELAY, time_of_day_s=100.0), waypoint(B))
    crew.utc_s = 86400.0 * 20000 + 90.0
    crew.resume_mission()
    assert crew.resume_mission(arrived=True) == GoTo(A, None, 20.0, 100.0)
    for _ in range(9):
        crew.utc_s += 1.0
        crew.resume_mission(arrived=True)
        assert crew.progress.index == 1
    crew.utc_s += 1.0
    assert crew.resume_mission(arrived=True) == GoTo(B, A, 20.0, 100.0)


def test_a_time_of_day_is_found_anew_by_a_clock_that_was_put_back():
    crew = Crew(MissionStep(Command.DELAY, time_of_day_s=100.0), waypoint(A))
    crew.utc_s = 86400.0 * 20000 + 90.0
    crew.resume_mission()
    crew.utc_s -= 86400.0 * 7000
    for second in range(12):
        assert crew.progress.index == int(second >= 10)
        crew.utc_s += 1.0
        crew.resume_mission()


def test_jumps_are_counted():
    crew = Crew(waypoint(A), waypoint(B), jump(0, 2), waypoint(C))
    places = [crew.resume_mission().place, *(crew.resume_mission(arrived=True).place for _ in range(6))]
    assert places == [A, B, A, B, A, B, C]


def test_jumping_for_ever_is_sailed_for_ever_but_never_in_one_step():
    crew = Crew(waypoint(A), waypoint(B), jump(0, -1))
    for _ in range(100):
        crew.resume_mission(arrived=True)
        crew.resume_mission()
    assert not crew.progress.complete


def test_jumps_that_lead_nowhere_make_the_mission_unusable_and_she_keeps_station():
    crew = Crew(MissionStep(Command.CHANGE_SPEED), jump(0, -1))
    for _ in range(20):
        crew.resume_mission()
    assert crew.progress.unusable
    assert crew.progress.task == HoldStation(HERE, 100.0)


def test_counted_jumps_over_nothing_that_takes_time_are_made_and_lead_on():
    speed = MissionStep(Command.CHANGE_SPEED)
    crew = Crew(waypoint(A), speed, jump(1, 300), jump(2, 3), jump(0, 1), waypoint(B))
    crew.resume_mission()
    places = []
    for _ in range(2):
        crew.resume_mission(arrived=True)
        for _ in range(60):
            crew.resume_mission()
        places.append(crew.progress.task.place)
    assert places == [A, B]
    assert not crew.progress.unusable
    assert crew.reached.count(1) == 301 + 1


def test_an_empty_mission_is_unusable_and_station_is_kept():
    crew = Crew()
    assert crew.resume_mission() == HoldStation(HERE, 100.0)
    assert crew.progress.unusable
    assert mission_progress.state_of(crew.progress, 0, running=True) is MissionState.NO_MISSION


def test_home_is_set_here_or_there_and_a_speed_changes_nothing():
    crew = Crew(MissionStep(Command.SET_HOME, B), MissionStep(Command.CHANGE_SPEED), waypoint(A))
    assert crew.resume_mission().place == A
    assert crew.home == B
    assert crew.reached == [0, 1]
    here = Crew(MissionStep(Command.SET_HOME), MissionStep(None), waypoint(A))
    here.resume_mission()
    assert here.home == HERE


def test_without_autocontinue_she_waits_to_be_told():
    crew = Crew(waypoint(A, autocontinue=False), waypoint(B))
    for _ in range(20):
        assert crew.resume_mission(arrived=True).place == A
    assert crew.reached == [0]
    assert mission_progress.state_of(crew.progress, 2, running=True) is MissionState.PAUSED
    # An arming, or the end of a failsafe, is no word to go on.
    crew.progress = mission_progress.enter(crew.progress)
    assert crew.resume_mission(arrived=True).place == A
    assert mission_progress.state_of(crew.progress, 2, running=True) is MissionState.PAUSED
    crew.progress = mission_progress.resume_mission(crew.progress, crew.steps)
    assert crew.resume_mission().place == B
    assert mission_progress.state_of(crew.progress, 2, running=True) is MissionState.ACTIVE
    assert mission_progress.resume_mission(crew.progress, crew.steps) is crew.progress


def test_a_pause_is_kept_where_she_is_and_the_item_goes_on():
    crew = Crew(waypoint(A), waypoint(B))
    task = crew.resume_mission()
    crew.progress = mission_progress.pause(crew.progress)
    crew.motion = replace(crew.motion, place=C)
    crew.resume_mission()
    crew.motion = replace(crew.motion, place=A)
    crew.resume_mission()
    assert crew.progress.pause_task == HoldStation(C, 100.0)
    assert mission_progress.state_of(crew.progress, 2, running=True) is MissionState.PAUSED
    crew.progress = mission_progress.resume_mission(crew.progress, crew.steps)
    assert crew.resume_mission() == task


def test_another_item_begins_from_where_she_is_and_a_restart_forgets_jumps():
    crew = Crew(waypoint(A), jump(0, 1), waypoint(B))
    crew.resume_mission()
    crew.resume_mission(arrived=True)
    assert crew.progress.jumps == ((1, 1),)
    crew.progress = mission_progress.at_item(crew.progress, 2, restart=False)
    assert crew.resume_mission() == GoTo(B, None, 20.0, 100.0)
    assert crew.progress.jumps
    assert mission_progress.at_item(crew.progress, 0, restart=True).jumps == ()


def test_auto_again_goes_on_with_the_item_and_after_the_end_from_the_first():
    crew = Crew(waypoint(A), waypoint(B))
    crew.resume_mission()
    crew.resume_mission(arrived=True)
    crew.progress = mission_progress.enter(crew.progress)
    assert crew.resume_mission() == GoTo(B, None, 20.0, 100.0)
    crew.resume_mission(arrived=True)
    assert crew.progress.complete
    crew.progress = mission_progress.enter(crew.progress)
    assert crew.resume_mission() == GoTo(A, None, 20.0, 100.0)


def test_a_new_mission_begins_at_its_first_item():
    progress = MissionProgress(identity=1, index=5, jumps=((1, 1),), started=True)
    assert mission_progress.for_plan(progress, 1) is progress
    assert mission_progress.for_plan(progress, 2) == MissionProgress(identity=2)
    assert mission_progress.state_of(MissionProgress(), 3, running=False) is MissionState.NOT_STARTED
    assert mission_progress.state_of(progress, 6, running=False) is MissionState.PAUSED


def test_headings_are_turned_to_and_held_without_a_position():
    turn = MissionStep(Command.YAW, angle_rad=1.0)
    crew = Crew(turn, MissionStep(Command.DELAY, seconds=30.0), jump(0, 1), waypoint(A))
    assert crew.resume_mission(position=False) == HoldHeading(1.0)
    crew.motion = replace(crew.motion, heading_rad=1.0)
    for _ in range(62):
        crew.resume_mission(position=False)
    assert crew.reached == [0, 1, 2, 0, 1, 2]
    assert crew.resume_mission(position=False) == GoTo(
        A, None, 20.0, 100.0
    )  # a place of its own needs none to be asked for


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
def test_what_asks_where_she_is_waits_for_a_position(step):
    crew = Crew(step, waypoint(A))
    assert crew.resume_mission(position=False) is None
    assert (crew.progress.index, crew.progress.begun, crew.progress.complete) == (0, False, False)
    assert crew.resume_mission() is not None
    assert crew.progress.begun


def test_a_mission_of_headings_ends_when_it_is_known_where_to_stay():
    crew = Crew(MissionStep(Command.YAW, angle_rad=0.0))
    for _ in range(5):
        assert crew.resume_mission(position=False) == HoldHeading(0.0)
    assert not crew.progress.complete
    assert crew.resume_mission() == HoldStation(HERE, 100.0)
    assert crew.progress.complete


def test_a_stay_is_not_timed_while_it_is_not_known_where_she_is():
    crew = Crew(waypoint(A, seconds=10.0), waypoint(B))
    crew.resume_mission()
    for _ in range(30):
        assert crew.resume_mission(arrived=True, position=False).place == A
    for _ in range(9):
        assert crew.resume_mission(arrived=True).place == A
    assert crew.resume_mission(arrived=True).place == B


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
def test_whatever_the_mission_she_always_has_a_task_and_the_index_is_one(found, arrivals):
    crew = Crew(*found)
    for arrived in arrivals:
        assert crew.resume_mission(arrived=arrived, turned_rad=30.0) is not None
        assert 0 <= crew.progress.index < max(1, len(found)) or not crew.progress.begun
    assert all(0 <= index < len(found) for index in crew.reached)
