"""The place that outlives a restart: where she is reckoned on from without a receiver."""

import math
from dataclasses import replace

import pytest

from firmware_py.common.geodesy import Place
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, PositionSample
from firmware_py.core import last_place
from firmware_py.core.last_place import STEP_M, LastPlace
from firmware_py.core.resume import from_text, restore, resume_of, to_text
from firmware_py.core.resume_keeper import FINE_INTERVAL_S, ResumeKeeper
from firmware_py.core.state import State
from firmware_py.estimate import reckoning
from firmware_py.estimate.position import PositionState, unfixed_s
from firmware_py.estimate.reckoning import ANYWHERE_M, Reckoning
from firmware_py.modes import ModeState

UTC_S = 1.8e9
WATER = Reckoning(0.1, -0.05, 0.5, 0.06, (1e-4,) * 10, -40.0, north_s=30.0, east_s=20.0, blind_m=5.0)
LAST = LastPlace(0.6, 2.0, UTC_S, "a", WATER)
HERE = Place(0.6, 2.0)


def at_sea(place):
    state = State.at_start(ParameterSet().replaced("BOOT_RESUME", 2))
    return replace(state, modes=ModeState(Mode.LOITER, armed=True), position=place)


def reckoned(t_s=100.0, begun_s=60.0):
    return PositionState(t_s, 0.6, 2.0, reckoning=replace(WATER, begun_s=begun_s))


def test_the_reckoning_goes_on_with_the_water_and_all_that_was_uncertain():
    text = to_text(resume_of(at_sea(reckoned()), UTC_S, "a"))
    state, notes = restore(at_sea(PositionState()), text, UTC_S, "a")
    assert notes == ()
    assert last_place.counted_from(state.position, 7.0) == reckoned(7.0, -33.0)
    assert unfixed_s(state.position) == 40.0
    assert state.heading_estimator.wave_filter.expected_water == (0.1, -0.05, 0.5)  # not in steps of 0.1


def test_while_she_was_away_the_water_carried_her_and_nobody_knows_where_she_headed():
    state = last_place.restored(LAST, UTC_S + 20.0, "a")
    assert HERE.offset_m(Place(state.latitude_rad, state.longitude_rad)) == pytest.approx((2.0, -1.0), abs=1e-6)
    assert (state.reckoning.blind_m, unfixed_s(state)) == (5.0 + 20.0 * 0.5, 60.0)
    sure_m, unsure_m = reckoning.spread_m(WATER, 60.0), reckoning.spread_m(state.reckoning, 60.0)
    assert unsure_m == pytest.approx(math.sqrt(sure_m**2 - 5.0**2 + 15.0**2))


@pytest.mark.parametrize(
    ("utc_s", "kept", "boot"),
    [(UTC_S + 20.0, "a", "b"), (UTC_S + 20.0, "", ""), (UTC_S - 20.0, "a", "a")],
    ids=["no power", "unknown", "clock put back"],
)
def test_she_may_be_anywhere_where_nobody_knows_how_long_it_was(utc_s, kept, boot):
    state = last_place.restored(replace(LAST, boot=kept), utc_s, boot)
    assert (state.latitude_rad, state.longitude_rad) == (0.6, 2.0)
    assert reckoning.spread_m(state.reckoning, 40.0) >= ANYWHERE_M


@pytest.mark.parametrize(
    "broken",
    [
        replace(LAST, latitude_rad=1.6),
        replace(LAST, longitude_rad=-3.2),
        replace(LAST, reckoning=replace(WATER, covariance=(0.0,) * 9)),
        replace(LAST, reckoning=replace(WATER, begun_s=1.0)),
    ],
)
def test_a_place_that_cannot_be_is_none(broken):
    assert last_place.restored(broken, UTC_S, "a") == PositionState()


def test_there_is_none_to_be_kept_before_a_fix_or_before_a_heading():
    assert resume_of(at_sea(PositionState()), UTC_S, "a").place is None
    fix = PositionSample(0.0, FixType.FIX_3D, 0.6, 2.0)
    assert resume_of(at_sea(PositionState(0.0, 0.6, 2.0, fix)), UTC_S, "a").place is None


def moved(metres):
    return replace(reckoned(), latitude_rad=HERE.at_offset(metres, 0.0).latitude_rad)


@pytest.mark.parametrize(("metres", "written"), [(0.9 * STEP_M, False), (1.1 * STEP_M, True)])
def test_it_is_written_anew_when_she_has_come_further_and_as_she_ends(metres, written):
    keeper = ResumeKeeper("a")
    assert keeper.update(at_sea(reckoned()), 0.0, UTC_S)
    state = at_sea(moved(metres))
    assert keeper.update(state, 0.1, UTC_S + 0.1) is None
    text = keeper.update(state, FINE_INTERVAL_S + 0.2, UTC_S + 30.2)
    assert (text is not None) is written
    last = from_text(keeper.update(at_sea(moved(metres + 1.0)), 31.0, UTC_S + 31.0, last=True))[0].place
    assert (last.latitude_rad, last.utc_s, last.boot) == (moved(metres + 1.0).latitude_rad, UTC_S + 31.0, "a")
