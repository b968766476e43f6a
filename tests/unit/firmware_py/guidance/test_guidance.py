"""Guidance of a tick: update times and state changes."""

import pytest
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanKind, Plans
from firmware_py.common.reports import Home
from firmware_py.guidance import guidance
from firmware_py.guidance.guidance import GuidanceInput, GuidanceSettings, GuidanceState
from firmware_py.guidance.tasks import GoTo, TaskSettings, VesselMotion
from firmware_py.modes import ModeState, PositionGoal
from support.plans import FENCE_ITEMS, item, mission, placed

FENCE = Plans(fence=Plan.of(PlanKind.FENCE, FENCE_ITEMS))
SETTINGS = GuidanceSettings.of(ParameterSet())
MOTION = VesselMotion(Place(*placed(0.0, 0.0)), 0.0, 0.4, 0.0, 0.0)
WAYPOINT, DELAY, SET_HOME = 16, 93, 179
GUIDED = ModeState(Mode.GUIDED, armed=True, goal=PositionGoal(*placed(500.0, 0.0)))
AUTO = ModeState(Mode.AUTO, armed=True)


def guidance_input(t_s, modes=GUIDED, plans=Plans(), *, new_fix=False, motion=MOTION):  # noqa: B008 - frozen
    return GuidanceInput(t_s, 0.0, motion, new_fix, modes, plans, None, None)


def run(times_s, state=GuidanceState(), fixes=(), **inputs):  # noqa: B008 - frozen
    """Return the times of updates, and the final state."""
    update_times_s = []
    for t_s in times_s:
        state = guidance.update(SETTINGS, state, guidance_input(t_s, new_fix=t_s in fixes, **inputs)).state
        if state.updated_s == t_s:
            update_times_s.append(t_s)
    return update_times_s, state


@pytest.mark.parametrize(
    ("gain_1_s", "speed_m_s", "limit_deg", "radius_m"),
    [(0.05, 0.4, 30.0, 15.279), (20.0, 0.05, 60.0, 1.0), (0.0001, 5.0, 1.0, 1000.0)],
)
def test_turning_radius_is_that_at_full_rudder_from_1_to_1000_m(gain_1_s, speed_m_s, limit_deg, radius_m):
    values = ParameterSet().replaced("MDL_K", gain_1_s).replaced("MDL_SPEED", speed_m_s)
    settings = TaskSettings.of(values.replaced("RUD_LIMIT_DEG", limit_deg))
    assert settings.turning_radius_m == pytest.approx(radius_m, abs=1e-3)


def test_guidance_is_updated_twice_a_second_and_at_each_fix():
    ticks_s = [100.0 + tick / 16.0 for tick in range(33)]
    assert run(ticks_s)[0] == [100.0, 100.5, 101.0, 101.5, 102.0]
    assert run(ticks_s, fixes=(100.25, 101.0625))[0] == [100.0, 100.25, 100.75, 101.0625, 101.5625]


@pytest.mark.parametrize(
    "change",
    [
        {"modes": replace(GUIDED, mode=Mode.LOITER)},
        {"modes": replace(GUIDED, armed=False)},
        {"plans": mission(item(WAYPOINT, 100.0, 0.0))},
    ],
)
def test_guidance_is_updated_after_a_change_of_mode_arming_or_mission(change):
    _, state = run([100.0])
    assert run([100.125], state)[0] == []
    assert run([100.125], state, **change)[0] == [100.125]


def test_state_is_unchanged_between_updates():
    _, state = run([100.0])
    assert guidance.update(SETTINGS, state, guidance_input(100.25)).state is state


@pytest.mark.parametrize(("pause_s", "counted_s"), [(0.75, 0.75), (3600.0, 5.0), (-50.0, 0.0)])
def test_time_step_of_a_delay_is_limited(pause_s, counted_s):
    inputs = {"modes": AUTO, "plans": mission(item(DELAY, None, None, 1000.0), item(WAYPOINT, 100.0, 0.0))}
    _, state = run([100.0, 100.5], **inputs)
    former_s = state.mission.elapsed_s
    assert former_s == 0.5
    _, state = run([100.5 + pause_s], state, fixes=(100.5 + pause_s,), **inputs)
    assert state.mission.elapsed_s == pytest.approx(former_s + counted_s)


@pytest.mark.parametrize(("home", "altitude_m"), [(None, 0.0), (Home(0.1, 0.2, 7.0), 7.0)])
def test_home_of_a_mission_keeps_the_altitude(home, altitude_m):
    inputs = guidance_input(100.0, AUTO, mission(item(SET_HOME, 300.0, 0.0), item(WAYPOINT, 100.0, 0.0)))
    new_home = guidance.update(SETTINGS, GuidanceState(), replace(inputs, home=home)).home
    assert (new_home.latitude_rad, new_home.longitude_rad) == pytest.approx(placed(300.0, 0.0), abs=1e-9)
    assert new_home.altitude_m == altitude_m


def test_return_task_keeps_its_destination_without_a_position():
    home, rtl = Home(*placed(300.0, 0.0), 0.0), replace(GUIDED, mode=Mode.RTL)

    def task_at(t_s, state, motion, home):
        inputs = replace(guidance_input(t_s, rtl, motion=motion), home=home)
        return guidance.update(SETTINGS, state, inputs).state

    state = task_at(100.0, GuidanceState(), None, home)
    assert state.task is None
    state = task_at(101.0, state, MOTION, home)
    destination = GoTo(Place(*placed(300.0, 0.0)), None, 20.0, 50.0)
    assert state.task == replace(destination, station_radius_m=SETTINGS.tasks.station_radius_m)
    for t_s, motion, present_home in ((102.0, None, home), (103.0, None, None), (104.0, MOTION, None)):
        assert task_at(t_s, state, motion, present_home).task == state.task
    moved = Place(*placed(0.0, 200.0))
    new_home = Home(moved.latitude_rad, moved.longitude_rad, 0.0)
    assert task_at(105.0, state, MOTION, new_home).task == replace(state.task, place=moved)


def test_mission_starts_with_arming():
    inputs = {"plans": mission(item(WAYPOINT, 100.0, 0.0))}
    _, state = run([100.0, 101.0], modes=replace(AUTO, armed=False), **inputs)
    assert not state.mission.started
    _, state = run([102.0], state, modes=AUTO, **inputs)
    assert (state.mission.started, state.mission.begun) == (True, True)


def test_new_mission_starts_in_auto():
    plans, new_plans = (
        mission(item(WAYPOINT, 100.0, 0.0)),
        mission(item(WAYPOINT, 200.0, 0.0), item(WAYPOINT, 0.0, 0.0)),
    )
    for modes, is_started in ((AUTO, True), (GUIDED, False)):
        _, state = run([100.0, 101.0], modes=modes, plans=plans)
        _, state = run([102.0], state, modes=modes, plans=new_plans)
        assert (state.mission.identity, state.mission.started) == (new_plans.mission.identity, is_started)


def test_fence_margin_needs_an_enabled_fence_and_a_position():
    _, state = run([100.0], plans=FENCE)
    assert guidance.fence_margin_m(state, FENCE, enabled=True) == pytest.approx(100.0 * 2.0**0.5 - 30.0, abs=0.5)
    assert guidance.fence_margin_m(state, FENCE, enabled=False) is None
    assert guidance.fence_margin_m(state, Plans(), enabled=True) is None
    assert guidance.fence_margin_m(GuidanceState(), FENCE, enabled=True) is None
    _, without_position = run([100.0], plans=FENCE, motion=None)
    assert guidance.fence_margin_m(without_position, FENCE, enabled=True) is None
