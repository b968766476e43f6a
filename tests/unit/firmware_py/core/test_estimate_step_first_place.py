"""Wrong first position of a receiver: home, goal and tasks are corrected, and this is reported."""

import math

import pytest

from firmware_py.common.geodesy import Place
from firmware_py.common.intents import ReplacePlan, SetHome, SteerPosition
from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import Plan, PlanKind
from firmware_py.guidance.tasks import HoldStation
from firmware_py.plans.items import Command
from support import rig
from support.plans import item, placed

WRONG_S, WRONG_M = 20.0, (30_000.0, -4_000.0)  # duration and error (north, east) of the wrong position
TEXT = "First GPS position wrong by "


def sail_from_wrong_position(mode, *intents, **parameters):
    """Return a boat whose receiver has a wrong position for 20 s, after the right one is accepted."""
    boat = rig.Sailing(rig.sea("calm"), POS_JUMP_S=30.0, **parameters)
    boat.jump_m = WRONG_M
    boat.get_under_way(mode, *intents)
    boat.run(WRONG_S - boat.t_s)
    boat.jump_m = (0.0, 0.0)
    return boat.run(60.0)


def north_east_m(place):
    return Place(*placed(0.0, 0.0)).nearby_offset_m(place)


def place_of(record):
    return Place(record.latitude_rad, record.longitude_rad)


def test_loiter_point_home_water_and_fence_are_reset():
    expected = rig.Sailing(rig.sea("calm")).state.heading_estimator.water.expected
    fence = ReplacePlan(Plan.of(PlanKind.FENCE, [item(Command.INCLUDED_CIRCLE, 0.0, 0.0, 500.0)]))
    boat = sail_from_wrong_position(Mode.LOITER, fence, FENCE_ENABLE=1, FS_FENCE_ACT=0)
    assert [len(boat.times_of(text)) for text in (TEXT, "Fence breached", "Fence breach cleared")] == [1, 1, 1]
    task, water = boat.state.guidance.task, boat.state.heading_estimator.water
    assert isinstance(task, HoldStation)
    for place in (task.centre, place_of(boat.state.home), water.origin):
        assert math.hypot(*north_east_m(place)) < 100.0
    assert boat.state.guidance.fence.margin_m == pytest.approx(450.0, abs=50.0)
    assert water.expected == expected


@pytest.mark.parametrize("offset_m", [(0.0, 0.0), (200.0, 300.0), (14_800.0, 0.0)])
def test_goal_and_home_near_the_wrong_position_are_moved(offset_m):
    position = placed(WRONG_M[0] + offset_m[0], WRONG_M[1] + offset_m[1])
    boat = sail_from_wrong_position(Mode.GUIDED, SetHome(*position, 0.0), SteerPosition(*position))
    for moved in (boat.state.home, boat.state.modes.goal):
        assert north_east_m(place_of(moved)) == pytest.approx(offset_m, abs=60.0)


@pytest.mark.parametrize("north_east_m", [(500.0, 300.0), (WRONG_M[0] - 15_500.0, WRONG_M[1])])
def test_goal_and_home_elsewhere_are_not_moved(north_east_m):
    """Elsewhere is farther from the wrong position than half of its error of 30.3 km."""
    position = placed(*north_east_m)
    boat = sail_from_wrong_position(Mode.GUIDED, SetHome(*position, 0.0), SteerPosition(*position))
    assert place_of(boat.state.home) == place_of(boat.state.modes.goal) == Place(*position)


def test_home_and_goal_return_after_a_temporary_error():
    boat = rig.Sailing(rig.sea("calm"), POS_JUMP_S=30.0).get_under_way(
        Mode.GUIDED, SteerPosition(*placed(500.0, 300.0))
    )
    home = place_of(boat.state.home)
    for jump_m, reports in ((WRONG_M, 1), ((0.0, 0.0), 2)):
        boat.jump_m = jump_m
        boat.run(60.0)
        assert len(boat.times_of(TEXT)) == reports
    assert math.hypot(*home.nearby_offset_m(place_of(boat.state.home))) < 100.0
    assert north_east_m(place_of(boat.state.modes.goal)) == pytest.approx((500.0, 300.0), abs=60.0)


def test_jump_long_after_the_first_position_corrects_nothing(monkeypatch):
    monkeypatch.setattr("firmware_py.estimate.position.FIRST_POSITION_PHASE_S", 10.0)
    boat = sail_from_wrong_position(Mode.LOITER)
    assert boat.times_of(TEXT) == []
    assert math.hypot(*north_east_m(boat.state.guidance.task.centre)) > 20_000.0


def test_positions_at_0_n_0_e_are_ignored(monkeypatch):
    boat = rig.Sailing(rig.sea("calm"))
    monkeypatch.setattr(rig, "placed", lambda *_: (0.0, 0.0))
    boat.run(5.0)
    assert boat.state.home is boat.state.position.fix is None
    monkeypatch.setattr(rig, "placed", placed)
    boat.run(5.0)
    assert math.hypot(*north_east_m(place_of(boat.state.home))) < 100.0
