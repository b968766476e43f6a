"""Stored position, from which dead reckoning continues after a restart."""

import math
import struct

import pytest
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, Inputs, PositionSample, Tick
from firmware_py.core import last_position
from firmware_py.core.last_position import LastPosition
from firmware_py.core.resume import Moment, from_bytes, restore, resume_of, to_bytes
from firmware_py.core.resume_writer import ResumeWriter
from firmware_py.core.state import State
from firmware_py.core.step import step
from firmware_py.estimate import dead_reckoning, water_results
from firmware_py.estimate.dead_reckoning import DeadReckoning
from firmware_py.estimate.position import PositionState, time_since_fix_s
from firmware_py.estimate.water import Expected
from firmware_py.modes import ModeState

MAX_MOVE_M = 25.0
FINE_INTERVAL_S = 30.0
MAX_AGE_S = 600.0
UNUSABLE_SD_M = 1e5

UTC_S = 1.8e9
WATER = DeadReckoning(
    water_results.DeadReckoning(0.1, -0.05, 0.5, 0.0, (1e-4,) * 10, cosine_s=30.0, sine_s=20.0, blind_m=5.0), -40.0
)
LAST = LastPosition(0.6, 2.0, WATER)
STORED_AT = Moment(UTC_S, "a", 500.0)
PLACE = Place(0.6, 2.0)


def at_sea(place):
    state = State.at_start(ParameterSet().replaced("BOOT_RESUME", 2))
    return replace(state, modes=ModeState(Mode.LOITER, armed=True), position=place)


def position_state(t_s=100.0, begun_s=60.0):
    return PositionState(t_s, 0.6, 2.0, dead_reckoning=replace(WATER, begun_s=begun_s))


def test_dead_reckoning_continues_with_water_and_uncertainty():
    text = to_bytes(resume_of(at_sea(position_state()), STORED_AT))
    state, notes = restore(at_sea(PositionState()), text, STORED_AT)
    assert notes == ()
    assert last_position.with_first_tick(state.position, 7.0) == position_state(7.0, -33.0)
    assert time_since_fix_s(state.position) == 40.0
    assert state.heading_estimator.water.expected == Expected(0.1, -0.05, 0.5)  # not rounded


def test_time_of_dead_reckoning_begins_with_the_first_tick():
    state, _ = restore(at_sea(PositionState()), to_bytes(resume_of(at_sea(position_state()), STORED_AT)), STORED_AT)
    for now_s in (7.0, 8.0, 9.0):
        state, _ = step(state, Inputs(Tick(0, now_s, 0.0, 0, 1.0)))
        assert (state.position.t_s, state.position.dead_reckoning.begun_s) == (now_s, -33.0)


def test_position_drifts_with_the_current_during_the_restart():
    state = last_position.restore(LAST, 20.0)
    assert PLACE.offset_m(Place(state.latitude_rad, state.longitude_rad)) == pytest.approx((2.0, -1.0), abs=1e-6)
    assert (state.dead_reckoning.water.blind_m, time_since_fix_s(state)) == (5.0 + 20.0 * 0.5, 60.0)
    sd_before_m, sd_m = (dead_reckoning.standard_deviation_m(w, 60.0) for w in (WATER, state.dead_reckoning))
    assert sd_m == pytest.approx(math.sqrt(sd_before_m**2 - 5.0**2 + 15.0**2))


@pytest.mark.parametrize(
    "utc_s", [UTC_S + 20.0, UTC_S - 86_400.0, UTC_S + 1e6, 0.0], ids=["right", "set back", "set forward", "1970"]
)
def test_elapsed_time_is_by_the_monotonic_clock_without_a_reboot(utc_s):
    text = to_bytes(resume_of(at_sea(position_state()), STORED_AT))
    state, _ = restore(at_sea(PositionState()), text, Moment(utc_s, "a", 520.0))
    assert (time_since_fix_s(state.position), state.position.dead_reckoning.water.blind_m) == (60.0, 5.0 + 20.0 * 0.5)
    assert state.greeting == "Resumed LOITER, 20 s old"


@pytest.mark.parametrize(
    ("stored", "now"),
    [
        (STORED_AT, Moment(UTC_S + 20.0, "b", 520.0)),
        (replace(STORED_AT, boot=""), Moment(UTC_S + 20.0, "", 520.0)),
        (STORED_AT, Moment(UTC_S + 20.0, "a", 480.0)),
    ],
    ids=["rebooted", "boot unknown", "impossible time"],
)
def test_position_error_is_unlimited_if_the_elapsed_time_is_unknown(stored, now):
    state, _ = restore(at_sea(PositionState()), to_bytes(resume_of(at_sea(position_state()), stored)), now)
    assert (state.position.latitude_rad, state.position.longitude_rad) == (0.6, 2.0)
    assert dead_reckoning.standard_deviation_m(state.position.dead_reckoning, 40.0) >= UNUSABLE_SD_M
    assert state.greeting == "Resumed LOITER, 20 s old"  # by the calendar clock


@pytest.mark.parametrize(
    "invalid",
    [
        replace(LAST, latitude_rad=1.6),
        replace(LAST, longitude_rad=-3.2),
        replace(LAST, dead_reckoning=replace(WATER, begun_s=1.0)),
    ],
)
def test_impossible_position_is_ignored_and_reported(invalid):
    text = to_bytes(replace(resume_of(at_sea(position_state()), STORED_AT), place=invalid))
    state, notes = restore(at_sea(PositionState()), text, STORED_AT)
    assert state.position == PositionState()
    assert notes == ("Resume.place ignored: invalid position or water data",)
    assert state.greeting.endswith(", incomplete")


@pytest.mark.parametrize(
    ("current_m_s", "speed_m_s", "valid_s"),
    [((0.0, 0.0), 0.0, 600.0), ((0.3, 0.4), 0.5, 25.0), ((-0.3, -0.4), -0.5, 25.0), ((0.0, 0.0), 0.025, 600.0)],
)
def test_position_is_valid_for_a_movement_of_25_m(current_m_s, speed_m_s, valid_s):
    water = WATER.water._replace(current_north_m_s=current_m_s[0], current_east_m_s=current_m_s[1], speed_m_s=speed_m_s)
    last = replace(LAST, dead_reckoning=replace(WATER, water=water))
    assert last_position.valid_for_s(last, 600.0) == pytest.approx(valid_s)


def test_no_position_is_stored_before_a_fix():
    assert resume_of(at_sea(PositionState()), STORED_AT).place is None


def test_position_without_a_heading_is_stored_with_the_expected_water():
    fix = PositionSample(0.0, FixType.FIX_3D, 0.6, 2.0)
    place = resume_of(at_sea(PositionState(0.0, 0.6, 2.0, fix)), STORED_AT).place
    assert (place.latitude_rad, place.longitude_rad) == (0.6, 2.0)
    assert last_position.water_of(place) == (0.0, 0.0, ParameterSet()["CRUISE_SPEED"])


def test_record_with_an_incomplete_covariance_has_that_of_unknown_water():
    number = struct.pack(">Bd", 0xCB, 1e-4)  # MessagePack; nine numbers instead of ten
    text = to_bytes(resume_of(at_sea(position_state()), STORED_AT)).replace(
        b"covariance\x9a" + number, b"covariance\x99"
    )
    state, notes = restore(at_sea(PositionState()), text, STORED_AT)
    assert state.position.dead_reckoning.water.covariance == water_results.DeadReckoning().covariance
    assert len(notes) == 1
    assert "covariance" in notes[0]


def with_water(current_m_s, speed_m_s):
    water = WATER.water._replace(current_north_m_s=-current_m_s, current_east_m_s=0.0, speed_m_s=speed_m_s)
    return at_sea(replace(position_state(), dead_reckoning=replace(WATER, water=water)))


@pytest.mark.parametrize(("current_m_s", "speed_m_s"), [(0.0, 0.0), (0.1, 0.4), (0.5, 0.5), (1.5, 1.0)])
def test_stored_position_differs_by_at_most_the_step(current_m_s, speed_m_s):
    writer, state = ResumeWriter(Moment(0.0, "a", 500.0)), with_water(current_m_s, speed_m_s)
    assert writer.update(state, 0.0, UTC_S)
    stored_s = max_age_s = 0.0
    for t_s in range(1, 2 * round(MAX_AGE_S) + 60):
        max_age_s = max(max_age_s, t_s - stored_s)
        text = writer.update(state, float(t_s), UTC_S + t_s)
        if text:
            stored_s = t_s
            assert from_bytes(text)[0].machine_s == 500.0 + stored_s
    max_speed_m_s = current_m_s + speed_m_s
    assert max_age_s * max_speed_m_s <= MAX_MOVE_M + FINE_INTERVAL_S * max_speed_m_s
    assert max_age_s == pytest.approx(
        FINE_INTERVAL_S * math.ceil(MAX_MOVE_M / max_speed_m_s / FINE_INTERVAL_S) if max_speed_m_s else MAX_AGE_S
    )


def test_record_is_written_at_the_end_and_after_a_fix_or_a_clock_change():
    writer, state = ResumeWriter(Moment(0.0, "a", 500.0)), with_water(0.0, 0.0)
    assert writer.update(state, 0.0, UTC_S)
    assert writer.update(state, FINE_INTERVAL_S + 1.0, UTC_S + 31.0) is None
    assert writer.update(state, 62.0, UTC_S + 86_400.0)
    assert writer.update(at_sea(PositionState()), 93.0, UTC_S + 86_431.0)
    assert writer.update(state, 124.0, UTC_S + 86_462.0)
    last = from_bytes(writer.update(state, 125.0, UTC_S + 86_463.0, last=True))[0]
    assert (last.utc_s, last.boot, last.machine_s) == (UTC_S + 86_463.0, "a", 625.0)
