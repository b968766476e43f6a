"""Estimates of a tick: position, dead reckoning and home."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.intents import (
    Arm,
    Request,
    SetHome,
    SteerHeading,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    FixType,
    Inputs,
    PositionSample,
    Tick,
)
from firmware_py.common.reports import Home
from firmware_py.core.state import State
from firmware_py.core.step import step
from support.tick_boat import FIX, Boat


@pytest.mark.parametrize(("armed", "min_m", "max_m"), [(True, 21.0, 27.0), (False, 0.0, 3.0)])
def test_dead_reckoning_moves_the_position_only_while_armed(armed, min_m, max_m):
    boat = Boat(noise_rad=0.01)
    boat.position, boat.position_ticks = FIX, 10
    boat.get_under_way().tick(SteerHeading(0.5))
    boat.run(60.0)
    boat.tick(Arm(armed=armed))
    fix, boat.position = boat.state.position.fix, None
    boat.run(60.0)
    place = boat.state.position
    north_m = EARTH_RADIUS_M * (place.latitude_rad - fix.latitude_rad)
    east_m = EARTH_RADIUS_M * math.cos(0.5) * (place.longitude_rad - fix.longitude_rad)
    assert min_m <= math.hypot(north_m, east_m) <= max_m
    assert boat.events.count("Dead reckoning started: position error grows") == armed


@pytest.mark.parametrize(("armed", "gap_s", "is_reported"), [(1, 58, False), (1, 62, True), (0, 62, False)])
def test_fix_after_more_than_a_minute_of_dead_reckoning_is_reported(armed, gap_s, is_reported):
    state, texts = State.at_start(ParameterSet().replaced("BOOT_ARM", armed)), []
    for second in range(20 + gap_s + 2):
        has_fix = second <= 20 or second >= 20 + gap_s
        fixes = (PositionSample(float(second), FixType.FIX_3D, 0.5, 0.5),) if has_fix else ()
        state, output = step(state, Inputs(Tick(second, float(second), 0.0, 0, 1.0), positions=fixes))
        texts += [event.text for event in output.events]
    assert (
        [text for text in texts if text.startswith("GPS recovered after 1 min: position error")] != []
    ) is is_reported


@pytest.mark.parametrize(("armed", "used_until_s", "reports"), [(1, 61.0, 1), (0, 99.0, 0)])
def test_stuck_position_is_reported_and_not_used_while_armed(armed, used_until_s, reports):
    """A velocity of 0.5 m/s has moved the boat by more than 30 m after a minute."""
    state, texts = State.at_start(ParameterSet().replaced("BOOT_ARM", armed)), []
    for second in range(100):
        fix = replace(FIX, t_s=float(second), speed_over_ground_m_s=0.5, course_over_ground_rad=0.0)
        state, output = step(state, Inputs(Tick(second, float(second), 0.0, 0, 1.0), positions=(fix,)))
        texts += [event.text for event in output.events]
    assert state.position.fix.t_s == used_until_s
    assert texts.count("GPS position unchanged for 1 min: static hold?") == reports


# Latitude and longitude [rad].
WRONG_POSITION, RIGHT_POSITION, HOME = (0.0, 0.1), (0.5, 0.2), (0.4, 0.1)


def fixes(place, start_s, end_s, step_s=1):
    return [(float(t_s), *place) for t_s in range(start_s, end_s, step_s)]


@pytest.mark.parametrize(
    ("positions", "set_s", "expected"),
    [
        (fixes(WRONG_POSITION, 0, 20) + fixes(RIGHT_POSITION, 20, 100), None, [WRONG_POSITION, RIGHT_POSITION]),
        (
            fixes(WRONG_POSITION, 0, 20) + fixes(RIGHT_POSITION, 20, 100),
            10.0,
            [WRONG_POSITION, HOME],
        ),  # a commanded home is not changed
        (fixes(RIGHT_POSITION, 0, 3), 0.0, [HOME]),
        # A wrong first position is corrected for half an hour.
        (
            fixes(WRONG_POSITION, 10_000, 11_700, 10) + fixes(RIGHT_POSITION, 11_700, 11_900, 10),
            None,
            [WRONG_POSITION, RIGHT_POSITION],
        ),
        (fixes(WRONG_POSITION, 10_000, 11_900, 10) + fixes(RIGHT_POSITION, 11_900, 12_100, 10), None, [WRONG_POSITION]),
        # Later errors do not change home.
        (
            fixes(RIGHT_POSITION, 0, 1900, 10) + fixes(WRONG_POSITION, 1900, 2000) + fixes(RIGHT_POSITION, 2000, 2001),
            None,
            [RIGHT_POSITION],
        ),
    ],
)
def test_home_is_the_corrected_first_position_unless_it_is_set(positions, set_s, expected):
    state, homes = State.at_start(ParameterSet().replaced("POS_JUMP_S", 60.0)), []
    for index, (t_s, *place) in enumerate(positions):
        requests = (Request(t_s, SetHome(*HOME, 0.0)),) if t_s == set_s else ()
        samples = (PositionSample(t_s, FixType.FIX_3D, *place, 3.0),)
        state, output = step(state, Inputs(Tick(index, t_s, 0.0, 0, 1.0), (), samples, (), (), requests))
        homes.append(output.snapshot.home)
    altitudes_m = {WRONG_POSITION: 3.0, RIGHT_POSITION: 3.0, HOME: 0.0}
    assert list(dict.fromkeys(homes)) == [Home(*place, altitudes_m[place]) for place in expected]


def test_rtl_steers_to_the_corrected_home():
    boat = Boat(ParameterSet().replaced("POS_JUMP_S", 10.0), noise_rad=0.002)
    boat.position = PositionSample(0.0, FixType.FIX_3D, *WRONG_POSITION)
    output = boat.get_under_way(Mode.RTL).run(1.0)
    assert (
        output.snapshot.navigation.target_latitude_rad,
        output.snapshot.navigation.target_longitude_rad,
    ) == WRONG_POSITION
    boat.position = PositionSample(0.0, FixType.FIX_3D, *RIGHT_POSITION)
    output = boat.run(20.0)
    target = output.snapshot.navigation
    assert (target.target_latitude_rad, target.target_longitude_rad) == pytest.approx(RIGHT_POSITION, abs=1e-5)
    boat.tick(SetHome(0.50001, 0.2, 0.0))
    assert boat.run(1.0).snapshot.navigation.target_latitude_rad == 0.50001


def test_home_is_the_first_fix_until_it_is_set():
    state = State.at_start(ParameterSet())

    def tick(index, *intents, latitude_rad=None):
        nonlocal state
        t_s = 0.1 * index
        positions = () if latitude_rad is None else (PositionSample(t_s, FixType.FIX_3D, latitude_rad, 0.2, 3.0),)
        requests = tuple(Request(t_s, intent) for intent in intents)
        state, output = step(state, Inputs(Tick(index, t_s, 0.0, 0, 10.0), (), positions, (), (), requests))
        return output.snapshot.home

    assert tick(0, SetHome()) is None
    assert tick(1, latitude_rad=0.5) == Home(0.5, 0.2, 3.0)
    assert tick(2, latitude_rad=0.500001) == Home(0.5, 0.2, 3.0)
    assert tick(3, SetHome()) == Home(0.500001, 0.2, 3.0)
    assert tick(4, SetHome(0.1, -0.3, 2.0)) == Home(0.1, -0.3, 2.0)
    for invalid in (SetHome(2.0, 0.0), SetHome(0.0, math.nan), SetHome(0.0, 0.0, math.inf)):
        assert tick(5, invalid) == Home(0.1, -0.3, 2.0)
