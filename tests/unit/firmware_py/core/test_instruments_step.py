"""Wind and depth in a tick: motion of the boat for the wind, and faults of shallow water and strong wind."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    DepthSample,
    DeviceHealth,
    DeviceRole,
    DeviceState,
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    Tick,
    WindReference,
    WindSample,
)
from firmware_py.core.freshness import Age, Freshness
from firmware_py.core.instruments import InstrumentState
from firmware_py.core.instruments_step import watch_instruments
from firmware_py.core.state import State, settings_of
from firmware_py.core.step import step
from firmware_py.estimate.declination import Declination
from firmware_py.faults.fault import Fault

FIX = PositionSample(1.0, FixType.FIX_3D, 0.6, 2.1, speed_over_ground_m_s=1.5, course_over_ground_rad=math.pi / 2)


def tick_inputs(t_s, **samples):
    return Inputs(Tick(0, t_s, 0.0, 0, 10.0), **samples)


def health(role, state):
    return DeviceHealth(0.0, role, state, 1, 0)


APPARENT = (WindSample(10.0, 6.0, 0.0, WindReference.APPARENT),)


FRESH = Freshness(Age.FRESH, Age.FRESH, Age.FRESH)


def wind_of(state, samples=APPARENT, freshness=FRESH, **parameters):
    """Return the wind after a tick at 10 s."""
    values = ParameterSet()
    for name, value in parameters.items():
        values = values.replaced(name, value)
    state, _ = watch_instruments(settings_of(values), state, tick_inputs(10.0, wind=samples), freshness)
    return state.instruments.wind.report


def test_apparent_wind_needs_a_fresh_heading():
    assert wind_of(State()).wind_m_s is not None
    assert wind_of(State(), freshness=Freshness(Age.OLD, Age.FRESH, Age.FRESH)).wind_m_s is None


def test_velocity_of_an_old_fix_is_not_used():
    """At heading 0 the boat makes 0.5 m/s through the water (CRUISE_SPEED), and 1.5 m/s to the north by the fix."""
    state = State.at_start(ParameterSet())
    fix = replace(FIX, course_over_ground_rad=0.0)
    state = replace(state, position=replace(state.position, fix=fix))
    assert wind_of(state).north_m_s == pytest.approx(-6.0 + 1.5)
    assert wind_of(state, freshness=Freshness(Age.FRESH, Age.OLD, Age.FRESH)).north_m_s == pytest.approx(-6.0 + 0.5)


def test_wind_from_magnetic_north_uses_the_declination_of_the_parameter_or_the_model():
    magnetic = (WindSample(10.0, 6.0, 0.0, WindReference.MAGNETIC),)
    state = State()
    estimator = replace(state.heading_estimator, declination=Declination(declination_rad=0.2))
    state = replace(state, heading_estimator=estimator)
    by_parameter = wind_of(state, magnetic, CMP_DECL_DEG=30.0)
    assert by_parameter.from_rad == pytest.approx(math.radians(30.0))
    by_model = wind_of(state, magnetic, CMP_DECL_DEG=30.0, CMP_DECL_AUTO=1.0)
    assert by_model.from_rad == pytest.approx(0.2)
    without_position = wind_of(State(), magnetic, CMP_DECL_DEG=30.0, CMP_DECL_AUTO=1.0)
    assert without_position.from_rad == pytest.approx(math.radians(30.0))


def test_missing_sensor_is_reported_in_a_tick_without_any_input():
    state, texts = State.at_start(ParameterSet()), []
    for number, devices in enumerate([(health(DeviceRole.WIND, DeviceState.STARTING),), (), (), ()]):
        state, output = step(state, Inputs(Tick(number, 20.0 * number, 0.0, 0, 1.0), devices=devices))
        texts += [(20.0 * number, event.text) for event in output.events if "sensor" in event.text]
    assert texts == [(60.0, "Wind sensor: no data")]


def heading(t_s):
    return (HeadingSample(t_s, 0.5, NorthReference.TRUE),)


def run(parameters, seconds, *, depth_m=None, wind_m_s=None, state=None, start_s=0.0):
    """Run ticks of 1 s; return the state, the last snapshot and the texts with their times."""
    state = State.at_start(parameters) if state is None else state
    texts, output = [], None
    for number in range(seconds):
        t_s = start_s + float(number)
        samples = {"headings": heading(t_s)}
        if depth_m is not None:
            samples["depth"] = (DepthSample(t_s, depth_m),)
        if wind_m_s is not None:
            samples["wind"] = (WindSample(t_s, wind_m_s, 0.0, WindReference.NORTH),)
        state, output = step(state, Inputs(Tick(number, t_s, 0.0, 0, 1.0), **samples))
        texts += [(t_s, event.text) for event in output.events]
    return state, output.snapshot, texts


def texts_about(word, texts):
    return [(t_s, text) for t_s, text in texts if text.startswith(word)]


def is_set(snapshot, fault):
    return bool(snapshot.faults >> fault & 1)


def test_shallow_water_is_set_after_ten_seconds_and_cleared_after_thirty():
    parameters = ParameterSet().replaced("DEPTH_MIN", 20.0)
    state, snapshot, texts = run(parameters, 15, depth_m=19.0)
    assert texts_about("Water", texts) == [(10.0, "Water shallow: depth below DEPTH_MIN")]
    assert is_set(snapshot, Fault.WATER_SHALLOW)
    assert (snapshot.depth, snapshot.depth_ok) == (DepthSample(14.0, 19.0), True)
    state, snapshot, texts = run(parameters, 60, depth_m=21.9, state=state, start_s=15.0)
    assert texts_about("Water", texts) == []  # within the hysteresis
    state, snapshot, texts = run(parameters, 40, depth_m=22.1, state=state, start_s=75.0)
    assert texts_about("Water", texts) == [(104.0, "Water no longer shallow")]
    assert not is_set(snapshot, Fault.WATER_SHALLOW)


def test_a_single_false_echo_before_the_bottom_is_lost_is_no_shallow_water():
    parameters = ParameterSet().replaced("DEPTH_MIN", 20.0)
    state, _, _ = run(parameters, 5, depth_m=1.2)
    _, snapshot, texts = run(parameters, 100, state=state, start_s=5.0)
    assert texts_about("Water", texts) == []
    assert not is_set(snapshot, Fault.WATER_SHALLOW)


def test_shallow_water_stays_set_without_a_depth_until_the_limit_is_zero():
    parameters = ParameterSet().replaced("DEPTH_MIN", 20.0)
    state, _, _ = run(parameters, 15, depth_m=19.0)
    state, snapshot, _ = run(parameters, 100, state=state, start_s=15.0)
    assert is_set(snapshot, Fault.WATER_SHALLOW)
    assert not snapshot.depth_ok
    state = replace(state, parameters=ParameterSet())
    _, snapshot, _ = run(parameters, 40, state=state, start_s=115.0)
    assert not is_set(snapshot, Fault.WATER_SHALLOW)


def test_strong_wind_is_set_after_thirty_seconds_and_cleared_after_a_minute():
    parameters = ParameterSet().replaced("WIND_MAX", 15.0)
    state, snapshot, texts = run(parameters, 130, wind_m_s=16.0)
    assert texts_about("Wind", texts) == [(30.0, "Wind strong: speed above WIND_MAX")]
    assert is_set(snapshot, Fault.WIND_STRONG)
    assert snapshot.wind_ok
    assert snapshot.wind.mean_m_s == pytest.approx(16.0)
    state, _, texts = run(parameters, 200, wind_m_s=13.6, state=state, start_s=130.0)
    assert texts_about("Wind", texts) == []  # within the hysteresis
    _, snapshot, texts = run(parameters, 250, wind_m_s=13.0, state=state, start_s=330.0)
    assert [text for _, text in texts_about("Wind", texts)] == ["Wind no longer strong"]
    assert not is_set(snapshot, Fault.WIND_STRONG)


def test_strong_wind_is_cleared_sixty_seconds_after_the_last_strong_mean():
    parameters = ParameterSet().replaced("WIND_MAX", 15.0)
    state, _, _ = run(parameters, 40, wind_m_s=16.0)
    state, _, _ = run(parameters, 200, state=state, start_s=40.0)  # silent: the fault stays
    _, _, texts = run(parameters, 80, wind_m_s=5.0, state=state, start_s=240.0)
    assert texts_about("Wind", texts) == [(299.0, "Wind no longer strong")]


def test_without_limits_nothing_is_reported():
    _, snapshot, texts = run(ParameterSet(), 60, depth_m=0.5, wind_m_s=60.0)
    assert snapshot.faults >> Fault.WATER_SHALLOW == 0
    assert texts_about("W", texts) == []


def test_tick_without_these_sensors_has_no_values():
    state, snapshot, _ = run(ParameterSet(), 3)
    assert (snapshot.wind, snapshot.wind_ok, snapshot.depth, snapshot.depth_ok) == (None, False, None, False)
    assert state.instruments == InstrumentState()
