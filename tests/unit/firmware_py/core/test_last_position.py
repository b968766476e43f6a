"""The position that survives a restart, for dead reckoning without a receiver."""

import math
import struct

import pytest
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, PositionSample
from firmware_py.core import last_position
from firmware_py.core.last_position import MAX_MOVE_M, LastPosition
from firmware_py.core.resume import Moment, from_bytes, restore, resume_of, to_bytes
from firmware_py.core.resume_writer import FINE_INTERVAL_S, REFRESH_S, ResumeWriter
from firmware_py.core.state import State
from firmware_py.estimate import dead_reckoning, water_results
from firmware_py.estimate.dead_reckoning import UNUSABLE_SD_M, DeadReckoning
from firmware_py.estimate.position import PositionState, time_since_fix_s
from firmware_py.estimate.water import Expected
from firmware_py.modes import ModeState

UTC_S = 1.8e9
WATER = DeadReckoning(
    water_results.DeadReckoning(0.1, -0.05, 0.5, 0.0, (1e-4,) * 10, cosine_s=30.0, sine_s=20.0, blind_m=5.0), -40.0
)
LAST = LastPosition(0.6, 2.0, WATER)
THEN = Moment(UTC_S, "a", 500.0)
HERE = Place(0.6, 2.0)


def at_sea(place):
    state = State.at_start(ParameterSet().replaced("BOOT_RESUME", 2))
    return replace(state, modes=ModeState(Mode.LOITER, armed=True), position=place)


def position_state(t_s=100.0, begun_s=60.0):
    return PositionState(t_s, 0.6, 2.0, dead_reckoning=replace(WATER, begun_s=begun_s))


def test_dead_reckoning_continues_with_water_and_uncertainty():
    text = to_bytes(resume_of(at_sea(position_state()), THEN))
    state, notes = restore(at_sea(PositionState()), text, THEN)
    assert notes == ()
    assert last_position.at_first_tick(state.position, 7.0) == position_state(7.0, -33.0)
    assert time_since_fix_s(state.position) == 40.0
    assert state.heading_estimator.water.expected == Expected(0.1, -0.05, 0.5)  # not in steps of 0.1


def test_during_the_restart_the_boat_drifts_with_an_unknown_heading():
    state = last_position.restored(LAST, 20.0)
    assert HERE.offset_m(Place(state.latitude_rad, state.longitude_rad)) == pytest.approx((2.0, -1.0), abs=1e-6)
    assert (state.dead_reckoning.water.blind_m, time_since_fix_s(state)) == (5.0 + 20.0 * 0.5, 60.0)
    sure_m, unsure_m = (
        dead_reckoning.standard_deviation_m(WATER, 60.0),
        dead_reckoning.standard_deviation_m(state.dead_reckoning, 60.0),
    )
    assert unsure_m == pytest.approx(math.sqrt(sure_m**2 - 5.0**2 + 15.0**2))


@pytest.mark.parametrize(
    "utc_s", [UTC_S + 20.0, UTC_S - 86_400.0, UTC_S + 1e6, 0.0], ids=["right", "back", "on", "1970"]
)
def test_the_calendar_clock_does_not_matter_while_the_computer_runs(utc_s):
    text = to_bytes(resume_of(at_sea(position_state()), THEN))
    state, _ = restore(at_sea(PositionState()), text, Moment(utc_s, "a", 520.0))
    assert (time_since_fix_s(state.position), state.position.dead_reckoning.water.blind_m) == (60.0, 5.0 + 20.0 * 0.5)
    assert state.greeting == "Resumed LOITER, 20 s old"


@pytest.mark.parametrize(
    ("stored", "now"),
    [
        (THEN, Moment(UTC_S + 20.0, "b", 520.0)),
        (replace(THEN, boot=""), Moment(UTC_S + 20.0, "", 520.0)),
        (THEN, Moment(UTC_S + 20.0, "a", 480.0)),
    ],
    ids=["no power", "unknown", "impossible"],
)
def test_the_position_error_is_unlimited_if_the_elapsed_time_is_unknown(stored, now):
    state, _ = restore(at_sea(PositionState()), to_bytes(resume_of(at_sea(position_state()), stored)), now)
    assert (state.position.latitude_rad, state.position.longitude_rad) == (0.6, 2.0)
    assert dead_reckoning.standard_deviation_m(state.position.dead_reckoning, 40.0) >= UNUSABLE_SD_M
    assert state.greeting == "Resumed LOITER, 20 s old"  # as far as the calendar knows


@pytest.mark.parametrize(
    "broken",
    [
        replace(LAST, latitude_rad=1.6),
        replace(LAST, longitude_rad=-3.2),
        replace(LAST, dead_reckoning=replace(WATER, begun_s=1.0)),
    ],
)
def test_an_impossible_position_is_ignored_and_reported(broken):
    text = to_bytes(replace(resume_of(at_sea(position_state()), THEN), place=broken))
    state, notes = restore(at_sea(PositionState()), text, THEN)
    assert state.position == PositionState()
    assert notes == ("Resume.place ignored: invalid position or water data",)
    assert state.greeting.endswith(", incomplete")


def test_no_position_is_stored_before_a_fix():
    assert resume_of(at_sea(PositionState()), THEN).place is None


def test_a_position_without_a_heading_is_stored_with_the_expected_water():
    fix = PositionSample(0.0, FixType.FIX_3D, 0.6, 2.0)
    place = resume_of(at_sea(PositionState(0.0, 0.6, 2.0, fix)), THEN).place
    assert (place.latitude_rad, place.longitude_rad) == (0.6, 2.0)
    assert last_position.water_of(place) == (0.0, 0.0, ParameterSet()["CRUISE_SPEED"])


def test_a_record_of_water_without_its_covariance_is_as_uncertain_as_unknown_water():
    number = struct.pack(">Bd", 0xCB, 1e-4)  # MessagePack: ten of them become nine
    text = to_bytes(resume_of(at_sea(position_state()), THEN)).replace(b"covariance\x9a" + number, b"covariance\x99")
    state, notes = restore(at_sea(PositionState()), text, THEN)
    assert state.position.dead_reckoning.water.covariance == water_results.UNKNOWN_WATER
    assert len(notes) == 1
    assert "covariance" in notes[0]


def with_water(current_m_s, speed_m_s):
    water = WATER.water._replace(current_north_m_s=-current_m_s, current_east_m_s=0.0, speed_m_s=speed_m_s)
    return at_sea(replace(position_state(), dead_reckoning=replace(WATER, water=water)))


@pytest.mark.parametrize(("current_m_s", "speed_m_s"), [(0.0, 0.0), (0.1, 0.4), (0.5, 0.5), (1.5, 1.0)])
def test_a_restart_on_station_moves_the_position_by_at_most_the_step(current_m_s, speed_m_s):
    writer, state = ResumeWriter(Moment(0.0, "a", 500.0)), with_water(current_m_s, speed_m_s)
    assert writer.update(state, 0.0, UTC_S)
    kept_s = oldest_s = 0.0
    for t_s in range(1, 2 * round(REFRESH_S) + 60):
        oldest_s = max(oldest_s, t_s - kept_s)
        text = writer.update(state, float(t_s), UTC_S + t_s)
        if text:
            kept_s = t_s
            assert from_bytes(text)[0].machine_s == 500.0 + kept_s
    fastest_m_s = current_m_s + speed_m_s
    assert oldest_s * fastest_m_s <= MAX_MOVE_M + FINE_INTERVAL_S * fastest_m_s
    assert oldest_s == pytest.approx(
        FINE_INTERVAL_S * math.ceil(MAX_MOVE_M / fastest_m_s / FINE_INTERVAL_S) if fastest_m_s else REFRESH_S
    )


def test_the_record_is_written_at_the_end_and_when_a_fix_comes_or_the_clock_is_set():
    writer, state = ResumeWriter(Moment(0.0, "a", 500.0)), with_water(0.0, 0.0)
    assert writer.update(state, 0.0, UTC_S)
    assert writer.update(state, FINE_INTERVAL_S + 1.0, UTC_S + 31.0) is None
    assert writer.update(state, 62.0, UTC_S + 86_400.0)
    assert writer.update(at_sea(PositionState()), 93.0, UTC_S + 86_431.0)
    assert writer.update(state, 124.0, UTC_S + 86_462.0)
    last = from_bytes(writer.update(state, 125.0, UTC_S + 86_463.0, last=True))[0]
    assert (last.utc_s, last.boot, last.machine_s) == (UTC_S + 86_463.0, "a", 625.0)
