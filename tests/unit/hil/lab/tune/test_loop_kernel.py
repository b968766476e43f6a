"""The compiled closed loop against the firmware's own parts."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_py.common import angles
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import HeadingSample, NorthReference
from firmware_py.control.rudder_limit import RudderLimits
from firmware_py.control.rudder_limit import limited_command as limited
from firmware_py.control.s_surface import Gains
from firmware_py.control.s_surface import rudder_demand as demanded
from firmware_py.estimate import observer
from firmware_py.model.kt import rk4_step
from hil.lab.tune import loop_kernel, twins
from hil.lab.tune.cases import pilot_of

DEG = math.pi / 180.0
angle = st.floats(-1e3, 1e3)
course = st.floats(-4.0 * math.pi, 4.0 * math.pi)
rate = st.floats(-1.0, 1.0)


def parameters(**values: float) -> ParameterSet:
    chosen = ParameterSet()
    for name, value in values.items():
        chosen = chosen.replaced(name, value)
    return chosen


@given(angle)
@example(0.0)
@example(-0.0)
@example(math.pi)
@example(-math.pi)
@example(math.nextafter(math.pi, 0.0))
@example(2.0 * math.pi)
@example(-2.0 * math.pi)
@example(4.0 * math.pi)
@example(3.0 * math.pi)
@example(-1e-17)
def test_wrapping_is_the_firmware_s_to_the_last_bit(value):
    assert twins.wrap_pi(value) == angles.wrap_pi(value)
    assert twins.wrap_two_pi(value) == angles.wrap_two_pi(value)


@given(course, rate, st.floats(0.0, 200.0), st.floats(0.0, 50.0), st.floats(-0.3, 0.3))
def test_the_s_surface_is_the_firmware_s(error_rad, rate_rad_s, k1, k2, trim_rad):
    gains = Gains(k1, k2, 30.0 * DEG, 0.0254, trim_rad)
    ours = twins.rudder_demand(error_rad, rate_rad_s, k1, k2, 30.0 * DEG, 0.0254, trim_rad)
    assert ours == demanded(gains, error_rad, rate_rad_s)


@given(st.floats(-0.6, 0.6), st.floats(-2.0, 2.0), st.floats(0.0, 0.2), st.floats(0.01, 6.0), st.floats(0.0, 1.0))
def test_limit_slew_and_deadband_are_the_firmware_s(command_rad, demand_rad, deadband_rad, slew_rad_s, step_s):
    limits = RudderLimits(0.5, slew_rad_s, deadband_rad)
    ours = twins.limited_command(command_rad, demand_rad, step_s, 0.5, slew_rad_s, deadband_rad)
    assert ours == limited(limits, command_rad, demand_rad, step_s)


def settings(tau_s: float) -> observer.ObserverSettings:
    return observer.ObserverSettings.of(parameters(EST_TAU_S=tau_s))


@example(0.0, 0.0, 0.0, 0.13, 0.0625, 0.1)  # where a power of 2 is not the square
@given(st.floats(0.0, 6.28), rate, st.floats(-0.6, 0.6), st.floats(0.01, 1.0), course, st.floats(0.1, 30.0))
def test_the_observer_is_the_firmware_s(heading_rad, rate_rad_s, rudder_rad, step_s, measured_rad, tau_s):
    known = settings(tau_s)
    state = observer.HeadingState(0.0, heading_rad, rate_rad_s, 0.0)
    sample = HeadingSample(step_s, measured_rad, NorthReference.TRUE)
    theirs = observer.correct(known, state, sample, rudder_rad)
    decay, theta = math.exp(-step_s / known.model.turning_lag_s), math.exp(-step_s / known.tau_s)
    predicted = twins.observer_predict(
        heading_rad, rate_rad_s, rudder_rad, step_s, decay, known.model.turning_ability_1_s, known.model.turning_lag_s
    )
    seen_rad = angles.wrap_two_pi(measured_rad)
    ours = twins.observer_correct(*predicted, seen_rad, step_s, theta, known.yaw_rate_limit_rad_s)
    assert ours == (theirs.heading_rad, theirs.yaw_rate_rad_s)


STEP_S = 0.125  # a binary fraction: differences of times are then exact, as the twins take them to be
TASK = loop_kernel.Task(np.array([60.0, -30.0, 170.0]) * DEG, 2400, 1600, STEP_S)
TICKS = 3 * 2400


def firmware_loop(chosen: ParameterSet, ship, compass_rad, offset_rad) -> tuple[np.ndarray, np.ndarray]:
    """Sail with the firmware's own functions in place of the twins."""
    known = observer.ObserverSettings.of(chosen)
    gains, limits = Gains.of(chosen), RudderLimits.of(chosen)
    state = observer.HeadingState()
    inner_steps = int(ship[3])
    inner_s = STEP_S / inner_steps
    reach_rad = 30.0 * DEG * inner_s
    psi = r = rudder = command = told = 0.0
    headings, rudders = np.zeros(TICKS), np.zeros(TICKS)
    for tick in range(TICKS):
        headings[tick], rudders[tick] = psi, rudder
        now_s = tick * STEP_S
        resolution = math.pi / 1800.0
        reading_rad = math.floor((psi + compass_rad[tick]) / resolution + 0.5) * resolution
        sample = HeadingSample(now_s, angles.wrap_two_pi(reading_rad), NorthReference.TRUE)
        state = observer.update(known, state, [sample], told, now_s)
        error_rad = angles.wrap_pi(TASK.goals_rad[tick // TASK.leg_ticks] - state.heading_rad)
        command = limited(limits, command, demanded(gains, error_rad, state.yaw_rate_rad_s), STEP_S)
        count = 2.0 * math.pi / 4096.0
        told = math.floor(rudder / count + 0.5) * count
        target = math.floor(command / count + 0.5) * count
        for _ in range(inner_steps):
            after = rudder + angles.clamp(target - rudder, -reach_rad, reach_rad)
            psi, r = rk4_step(psi, r, 0.5 * (rudder + after), inner_s, *ship[:3], offset_rad[tick])
            rudder = after
    return headings, rudders


@pytest.mark.parametrize(
    ("k1", "k2", "tau_s", "deadband_deg", "inner_steps"),
    [(40.0, 0.3, 1.5, 0.0, 1), (20.0, 2.5, 8.0, 1.0, 2), (60.0, 0.0, 0.5, 0.3, 3)],
)
def test_a_long_run_is_the_firmware_s_to_the_last_bit(k1, k2, tau_s, deadband_deg, inner_steps):
    numbers = np.random.default_rng(7)
    wave = 0.2 * np.sin(np.arange(TICKS) * STEP_S * 0.9) + 0.1 * numbers.standard_normal(TICKS)
    offset = 0.1 * np.sin(np.arange(TICKS) * STEP_S * 0.01)
    ship = np.array([0.1, 3.0, 12.0, float(inner_steps)])
    chosen = parameters(CTL_K1=k1, CTL_K2=k2, EST_TAU_S=tau_s, RUD_DBAND_DEG=deadband_deg, CTL_TRIM_DEG=2.0)
    theirs = firmware_loop(chosen, ship, wave, offset)
    headings, rudders = np.zeros(TICKS), np.zeros(TICKS)
    row = (chosen["CTL_K1"], chosen["CTL_K2"], chosen["EST_TAU_S"], angles.radians(chosen["RUD_DBAND_DEG"]))
    loop_kernel.closed_loop(np.array(row), pilot_of(chosen), TASK, ship, wave, offset, headings, rudders)
    assert np.array_equal(headings, theirs[0])
    assert np.array_equal(rudders, theirs[1])
    assert np.ptp(rudders) > 0.5  # she has had work


def test_compiled_and_plain_agree_to_the_last_bit():
    numbers = np.random.default_rng(3)
    for _ in range(300):
        a, b, c = numbers.uniform(-3.0, 3.0, 3).tolist()
        assert twins.rudder_demand(a, b, 40.0, 0.3, 0.5, 0.025, 0.0) == twins.rudder_demand.py_func(
            a, b, 40.0, 0.3, 0.5, 0.025, 0.0
        )
        assert twins.limited_command(a, b, 0.1, 0.5, 0.5, 0.01) == twins.limited_command.py_func(
            a, b, 0.1, 0.5, 0.5, 0.01
        )
        assert twins.observer_predict(abs(a), b, c, 0.1, 0.97, 0.05, 4.0) == twins.observer_predict.py_func(
            abs(a), b, c, 0.1, 0.97, 0.05, 4.0
        )


def test_a_reading_is_rounded_to_a_tenth_of_a_degree_and_never_360():
    assert loop_kernel.compass_reading(12.34 * DEG) == pytest.approx(12.3 * DEG, abs=1e-12)
    assert loop_kernel.compass_reading(359.97 * DEG) == pytest.approx(0.0, abs=1e-12)
    assert loop_kernel.compass_reading(-0.2 * DEG) == pytest.approx(359.8 * DEG, abs=1e-12)
    assert 0.0 <= loop_kernel.compass_reading(725.0 * DEG) < 2.0 * math.pi


def test_the_measures_of_a_made_up_run():
    task = loop_kernel.Task(np.array([10.0, -20.0]), 4, 2, 0.5)
    heading = np.array([0.0, 12.0, 9.0, 9.0, 9.0, -10.0, -21.0, -23.0])
    rudder = np.array([0.0, 1.0, 1.0, 0.5, 0.0, 0.0, 2.0, -2.0])
    results = np.zeros(loop_kernel.RESULTS)
    loop_kernel.measure(task, heading, rudder, results)
    # t-weighted mean of |error|: (1*2 + 2*1 + 3*1) / 6 and (1*10 + 2*1 + 3*3) / 6, and their mean
    assert results[loop_kernel.ITAE] == pytest.approx((7.0 / 6.0 + 21.0 / 6.0) / 2.0)
    assert results[loop_kernel.RMS] == pytest.approx(math.sqrt((1.0 + 1.0 + 1.0 + 9.0) / 4.0))
    assert results[loop_kernel.MEAN] == pytest.approx(-2.0)
    # rudder over the steady parts: 0 + 0.5, then 2 + 4, in four ticks of half a second
    assert results[loop_kernel.TRAVEL] == pytest.approx(6.5 / 2.0)
    assert results[loop_kernel.OVERSHOOT] == pytest.approx(
        0.2
    )  # 2 beyond 10; the second leg never passes its goal early
