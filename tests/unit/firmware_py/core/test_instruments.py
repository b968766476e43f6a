"""Wind sensor and echo sounder: motion of the boat, age of the measurements, reports of silence, the whole tick."""

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
    Severity,
    Tick,
    WindReference,
    WindSample,
)
from firmware_py.common.reports import Water
from firmware_py.core import instruments
from firmware_py.core.freshness import Age, Freshness
from firmware_py.core.instruments import InstrumentLimits, InstrumentState
from firmware_py.core.instruments_step import watch_instruments
from firmware_py.core.state import State, settings_of
from firmware_py.core.step import step
from firmware_py.estimate.declination import Declination
from firmware_py.faults.fault import Fault

WATER = Water(0.5, 0.1, 0.2, -0.1, 0.1, leeway_rad=0.1)
FIX = PositionSample(1.0, FixType.FIX_3D, 0.6, 2.1, speed_over_ground_m_s=1.5, course_over_ground_rad=math.pi / 2)


def tick_inputs(t_s, **samples):
    return Inputs(Tick(0, t_s, 0.0, 0, 10.0), **samples)


def health(role, state):
    return DeviceHealth(0.0, role, state, 1, 0)


def test_velocity_is_that_of_the_fix_then_that_through_the_water_with_the_current():
    fixed = instruments.boat_motion(0.3, FIX, WATER, 0.1)
    assert (fixed.heading_rad, fixed.declination_rad) == (0.3, 0.1)
    assert (fixed.north_m_s, fixed.east_m_s) == pytest.approx((0.0, 1.5))
    expected = (0.5 * math.cos(0.4) + 0.2, 0.5 * math.sin(0.4) - 0.1)
    for fix in (None, replace(FIX, speed_over_ground_m_s=None), replace(FIX, course_over_ground_rad=None)):
        by_water = instruments.boat_motion(0.3, fix, WATER, 0.0)
        assert (by_water.north_m_s, by_water.east_m_s) == pytest.approx(expected)
    for heading_rad, water in ((None, WATER), (0.3, None)):
        unknown = instruments.boat_motion(heading_rad, None, water, 0.0)
        assert (unknown.north_m_s, unknown.east_m_s) == (0.0, 0.0)


def test_measurement_is_recent_for_fifteen_seconds():
    sample = DepthSample(10.0, 20.0)
    assert instruments.is_recent(sample, 25.0)
    assert not instruments.is_recent(sample, 25.01)
    assert not instruments.is_recent(None, 0.0)
    state = InstrumentState(depth=sample)
    assert instruments.recent_depth_m(state, 15.0) == 20.0  # for the fault
    assert instruments.recent_depth_m(state, 15.1) is None
    assert instruments.recent_depth_m(InstrumentState(), 0.0) is None
    assert instruments.recent_mean_wind_m_s(InstrumentState(), 0.0) is None
    wind = (WindSample(10.0, 6.0, 0.0, WindReference.NORTH),)
    windy = instruments.update(
        InstrumentState(), tick_inputs(10.0, wind=wind), instruments.boat_motion(None, None, None, 0.0)
    )
    assert instruments.recent_mean_wind_m_s(windy, 25.0) == pytest.approx(6.0)
    assert instruments.recent_mean_wind_m_s(windy, 25.1) is None


def test_newest_of_several_depths_is_used():
    motion = instruments.boat_motion(None, None, None, 0.0)
    both = tick_inputs(1.0, depth=(DepthSample(0.9, 20.0), DepthSample(1.0, 21.0)))
    assert instruments.update(InstrumentState(), both, motion).depth == DepthSample(1.0, 21.0)


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


def test_limits_are_those_of_the_parameters():
    parameters = ParameterSet().replaced("DEPTH_MIN", 12.5).replaced("WIND_MAX", 20.0)
    assert InstrumentLimits.of(parameters) == InstrumentLimits(12.5, 20.0)
    assert InstrumentLimits.of(ParameterSet()) == InstrumentLimits(0.0, 0.0)


@pytest.mark.parametrize(("role", "name"), [(DeviceRole.WIND, "Wind sensor"), (DeviceRole.DEPTH, "Depth sensor")])
@pytest.mark.parametrize("lost", [DeviceState.SILENT, DeviceState.ABSENT, DeviceState.FAULTY, DeviceState.FAILED])
def test_silence_and_recovery_are_reported(role, name, lost):
    state, events = instruments.report_silence(InstrumentState(), (health(role, DeviceState.RUNNING),), 1.0)
    assert events == ()
    state, (event,) = instruments.report_silence(state, (health(role, lost),), 1.0)
    assert (event.severity, event.text) == (Severity.WARNING, f"{name}: no data")
    state, events = instruments.report_silence(state, (health(role, lost),), 1.0)
    assert events == ()
    state, (event,) = instruments.report_silence(state, (health(role, DeviceState.RUNNING),), 1.0)
    assert (event.severity, event.text) == (Severity.NOTICE, f"{name}: data recovered")


@pytest.mark.parametrize("first", [DeviceState.ABSENT, DeviceState.STARTING, DeviceState.SILENT])
def test_sensor_that_was_never_received_is_reported_once_after_a_minute(first):
    devices = (health(DeviceRole.DEPTH, first), health(DeviceRole.COMPASS, first))
    state, events = instruments.report_silence(InstrumentState(), devices, 1.0)
    assert (events, instruments.is_expected(state)) == ((), True)
    assert instruments.report_silence(state, (), 59.9) == (state, ())
    missing, (event,) = instruments.report_silence(state, (), 60.0)
    assert (event.severity, event.text) == (Severity.WARNING, "Depth sensor: no data")
    assert not instruments.is_expected(missing)
    assert instruments.report_silence(missing, devices, 70.0) == (missing, ())
    _, (event,) = instruments.report_silence(missing, (health(DeviceRole.DEPTH, DeviceState.RUNNING),), 80.0)
    assert event.text == "Depth sensor: data recovered"
    received, events = instruments.report_silence(state, (health(DeviceRole.DEPTH, DeviceState.RUNNING),), 2.0)
    assert (events, instruments.report_silence(received, (), 60.0)) == ((), (received, ()))


@pytest.mark.parametrize(
    ("role", "name"),
    [
        (DeviceRole.RUDDER_ANGLE, "Rudder angle sensor"),
        (DeviceRole.COMPASS_B, "Compass B"),
        (DeviceRole.POWER, "Power monitor"),
        (DeviceRole.POWER_B, "Power monitor B"),
    ],
)
def test_further_device_is_reported_only_if_it_was_never_received(role, name):
    starting, running = (health(role, device_state) for device_state in (DeviceState.STARTING, DeviceState.RUNNING))
    state, events = instruments.report_silence(InstrumentState(), (starting,), 1.0)
    assert (events, instruments.is_expected(state)) == ((), True)
    missing, (event,) = instruments.report_silence(state, (), 60.0)
    assert (event.severity, event.text) == (Severity.WARNING, f"{name}: no data")
    assert instruments.report_silence(missing, (running, starting), 70.0) == (missing, ())
    for talking in (running, health(role, DeviceState.FAULTY)):
        received, events = instruments.report_silence(state, (talking,), 2.0)
        assert (events, instruments.is_expected(received)) == ((), False)
    assert instruments.report_silence(received, (health(role, DeviceState.SILENT), starting), 60.0) == (received, ())


def test_boat_without_these_sensors_reports_nothing():
    assert instruments.report_silence(InstrumentState(), (), 60.0) == (InstrumentState(), ())


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
