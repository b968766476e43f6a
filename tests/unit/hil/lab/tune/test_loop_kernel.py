"""The compiled closed loop, compared with the parts of the firmware."""

import math

import numpy as np
import pytest

from firmware_py.common import angles
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import HeadingSample, NorthReference
from firmware_py.control.law import Gains, s_surface
from firmware_py.control.rudder_limit import RudderLimits, limit_command
from firmware_py.estimate import observer
from firmware_py.model.kt import rk4_step
from hil.lab.tune import loop_kernel
from hil.lab.tune.cases import autopilot_of

DEG = math.pi / 180.0


def parameters_with(**values: float) -> ParameterSet:
    parameter_set = ParameterSet()
    for name, value in values.items():
        parameter_set = parameter_set.replaced(name, value)
    return parameter_set


STEP_S = 0.125  # a binary fraction, so that differences of times are exact, as the loop assumes
TASK = loop_kernel.Task(np.array([60.0, -30.0, 170.0]) * DEG, 2400, 1600, STEP_S)
TICKS = 3 * 2400


def firmware_loop(parameter_set: ParameterSet, ship, compass_rad, offset_rad) -> tuple[np.ndarray, np.ndarray]:
    """Simulate tick by tick with the observer and the records of the firmware."""
    observer_settings = observer.ObserverSettings.of(parameter_set)
    gains, limits = Gains.of(parameter_set), RudderLimits.of(parameter_set)
    state = observer.HeadingState()
    inner_steps = int(ship[3])
    inner_s = STEP_S / inner_steps
    max_change_rad = 30.0 * DEG * inner_s
    psi = r = rudder = command = feedback = 0.0
    headings, rudders = np.zeros(TICKS), np.zeros(TICKS)
    for tick in range(TICKS):
        headings[tick], rudders[tick] = psi, rudder
        now_s = tick * STEP_S
        resolution = math.pi / 1800.0
        reading_rad = math.floor((psi + compass_rad[tick]) / resolution + 0.5) * resolution
        sample = HeadingSample(now_s, angles.wrap_two_pi(reading_rad), NorthReference.TRUE)
        state = observer.update(observer_settings, state, [sample], feedback, now_s)
        error_rad = angles.wrap_pi(TASK.goals_rad[tick // TASK.leg_ticks] - state.heading_rad)
        command = limit_command(limits, command, s_surface(gains, error_rad, state.yaw_rate_rad_s), STEP_S)
        count = 2.0 * math.pi / 4096.0
        feedback = math.floor(rudder / count + 0.5) * count
        target = math.floor(command / count + 0.5) * count
        for _ in range(inner_steps):
            next_rudder = rudder + angles.clamp(target - rudder, -max_change_rad, max_change_rad)
            psi, r = rk4_step(psi, r, 0.5 * (rudder + next_rudder), inner_s, *ship[:3], offset_rad[tick])
            rudder = next_rudder
    return headings, rudders


@pytest.mark.parametrize(
    ("k1", "k2", "tau_s", "deadband_deg", "inner_steps"),
    [(40.0, 0.3, 1.5, 0.0, 1), (20.0, 2.5, 8.0, 1.0, 2), (60.0, 0.0, 0.5, 0.3, 3)],
)
def test_long_run_equals_the_firmware_to_the_last_bit(k1, k2, tau_s, deadband_deg, inner_steps):
    numbers = np.random.default_rng(7)
    wave = 0.2 * np.sin(np.arange(TICKS) * STEP_S * 0.9) + 0.1 * numbers.standard_normal(TICKS)
    offset = 0.1 * np.sin(np.arange(TICKS) * STEP_S * 0.01)
    ship = np.array([0.1, 3.0, 12.0, float(inner_steps)])
    parameter_set = parameters_with(CTL_K1=k1, CTL_K2=k2, EST_TAU_S=tau_s, RUD_DBAND_DEG=deadband_deg, CTL_TRIM_DEG=2.0)
    expected = firmware_loop(parameter_set, ship, wave, offset)
    headings, rudders = np.zeros(TICKS), np.zeros(TICKS)
    row = (
        parameter_set["CTL_K1"],
        parameter_set["CTL_K2"],
        parameter_set["EST_TAU_S"],
        angles.radians(parameter_set["RUD_DBAND_DEG"]),
    )
    loop_kernel.closed_loop(np.array(row), autopilot_of(parameter_set), TASK, ship, wave, offset, headings, rudders)
    assert np.array_equal(headings, expected[0])
    assert np.array_equal(rudders, expected[1])
    assert np.ptp(rudders) > 0.5  # the rudder moves


def test_compass_readings_are_rounded_and_below_360():
    assert loop_kernel.compass_reading(12.34 * DEG) == pytest.approx(12.3 * DEG, abs=1e-12)
    assert loop_kernel.compass_reading(359.97 * DEG) == pytest.approx(0.0, abs=1e-12)
    assert loop_kernel.compass_reading(-0.2 * DEG) == pytest.approx(359.8 * DEG, abs=1e-12)
    assert 0.0 <= loop_kernel.compass_reading(725.0 * DEG) < 2.0 * math.pi


def test_results_of_a_short_run_are_as_computed_by_hand():
    task = loop_kernel.Task(np.array([10.0, -20.0]), 4, 2, 0.5)
    heading = np.array([0.0, 12.0, 9.0, 9.0, 9.0, -10.0, -21.0, -23.0])
    rudder = np.array([0.0, 1.0, 1.0, 0.5, 0.0, 0.0, 2.0, -2.0])
    results = np.zeros(loop_kernel.RESULTS)
    loop_kernel.measure(task, heading, rudder, results)
    # mean of |error| weighted by time: (1*2 + 2*1 + 3*1) / 6 and (1*10 + 2*1 + 3*3) / 6, and their mean
    assert results[loop_kernel.ITAE] == pytest.approx((7.0 / 6.0 + 21.0 / 6.0) / 2.0)
    assert results[loop_kernel.RMS] == pytest.approx(math.sqrt((1.0 + 1.0 + 1.0 + 9.0) / 4.0))
    assert results[loop_kernel.MEAN] == pytest.approx(-2.0)
    # rudder over the steady parts: 0 + 0.5, then 2 + 4, in four ticks of half a second
    assert results[loop_kernel.TRAVEL] == pytest.approx(6.5 / 2.0)
    # 2 beyond 10; the second leg never passes its goal early
    assert results[loop_kernel.OVERSHOOT] == pytest.approx(0.2)
