"""The wave filter's prediction and its update by a heading (firmware_py/estimate/wave_filter.py) for compiled code."""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import clamp, radians, wrap_pi, wrap_two_pi
from hil.lab.compiled import compiled
from hil.lab.twin import kalman, learning
from hil.lab.twin.kalman import (
    BIAS,
    BIAS_MEAN,
    FLOAT,
    FLOAT_RATE,
    HEADING,
    RATE,
    STATES,
    WAVE,
    WAVE_RATE,
    Covariance,
    Floats,
)  # fmt: skip
from hil.lab.twin.learning import LOG_BIAS, LOG_FOLLOW, LOG_NOISE, LOG_OMEGA, LOG_ORBIT, LOG_POWER
from hil.lab.twin.wave_filter_state import (
    INNOVATION,
    INNOVATION_SD,
    REFUSALS,
    RUDDER,
    SAMPLE_T,
    SLOW_WAVE,
    STARTED,
    Filter,
    T,
    bound,
    forget,
    start,
)  # fmt: skip

LONGEST_STEP_S, LONGEST_SILENCE_S, LATEST_S = 1.0, 600.0, 1.0
GATE_SIGMAS, GATE_RAD = 6.0, radians(20.0)
HEADING_LIMIT = 5.0
FLOAT_WANDERS = 0.64
SWING_PERIODS, LEAST_TURN_RAD, TURN_SPREADS = 4.0, radians(15.0), 0.6
TURN_RATE_RAD_S, TURN_BIAS_RAD = radians(2.0), radians(20.0)
WHITE = np.array(
    (
        *(0.0, 1e-6 * radians(1.0) ** 2, 0.0, 0.0, 0.1 * radians(1.0) ** 2),
        *(5e-7, 5e-7),
        *(1e-5, 1e-6, 1e-7, 0.0, 1e-4 * radians(1.0) ** 2),
    )
)


@compiled
def predict_to(f: Filter, c: Covariance, model: Floats, to_s: float) -> None:
    """Propagate to a time; an earlier one changes nothing."""
    w = f.w
    while to_s - w[T] > 0.0:
        way_s = to_s - w[T]
        step_s = min(way_s, LONGEST_STEP_S)
        predict(f, c, model, step_s)
        w[T] = to_s if step_s == way_s else w[T] + step_s


@compiled
def predict(f: Filter, c: Covariance, model: Floats, step_s: float) -> None:
    """Propagate states, covariance and sensitivities by a step."""
    x, n = f.x, f.n
    omega_rad_s, follow_rad_s = math.exp(n[LOG_OMEGA]), math.exp(n[LOG_FOLLOW])
    wave = kalman.response(omega_rad_s, kalman.DAMPING, step_s)
    turned = kalman.turn(x, f.w[RUDDER], step_s, model, c.p[BIAS, BIAS])
    follow = kalman.response(follow_rad_s, kalman.FLOAT_DAMPING, step_s)
    orbit_power = learning.power_of(math.exp(0.5 * n[LOG_ORBIT]), omega_rad_s)
    keep = math.exp(-step_s / kalman.BIAS_MEMORY_S)
    noise, both, force = c.noise, c.both, c.force
    for i in range(WAVE):
        noise[i] = WHITE[i] * step_s
    noise[BIAS] = math.exp(n[LOG_BIAS]) * step_s
    noise[FLOAT_RATE] *= min(follow_rad_s * follow_rad_s, FLOAT_WANDERS)
    for number in range(3):
        place = WAVE + 2 * number
        power = orbit_power if number else math.exp(n[LOG_POWER])
        noise[place], both[number], noise[place + 1] = kalman.wave_noise(wave, omega_rad_s, power)
        pull = -2.0 * omega_rad_s * (omega_rad_s * x[place] + kalman.DAMPING * x[place + 1])
        force[2 * number], force[2 * number + 1] = 0.5 * step_s * step_s * pull, step_s * pull
    behind = x[FLOAT] - 0.5 * (x[HEADING] + turned[kalman.TURNED])
    pull = -2.0 * follow_rad_s * (follow_rad_s * behind + kalman.FLOAT_DAMPING * x[FLOAT_RATE])
    force[6], force[7] = 0.5 * step_s * step_s * pull, step_s * pull
    kalman.advance(x, turned, follow, wave, keep)
    bound(x)
    kalman.predict(c, turned, follow, wave, keep)


@compiled
def correct(f: Filter, c: Covariance) -> None:
    """Update by the measurement that `c` holds."""
    kalman.correct(f.x, c)
    bound(f.x)


@compiled
def finish(f: Filter, c: Covariance) -> bool:
    """Bring the headings within a turn; return whether the filter is sound, which is otherwise started again."""
    x = f.x
    if not kalman.is_sound(x, c.p):
        forget(f)
        return False
    heading_rad = wrap_two_pi(x[HEADING])
    x[FLOAT] += heading_rad - x[HEADING]
    x[HEADING] = heading_rad
    return True


@compiled
def give_turn_back(f: Filter, c: Covariance, step_s: float) -> None:
    """Follow the mean of the waves' yaw, and move a turn that the waves have been given to the heading."""
    x, n, w = f.x, f.n, f.w
    part = min(math.exp(n[LOG_OMEGA]) * step_s / (2.0 * math.pi * SWING_PERIODS), 0.5)
    turned_rad = w[SLOW_WAVE] + part * (x[WAVE] - w[SLOW_WAVE])
    w[SLOW_WAVE] = turned_rad
    if abs(turned_rad) <= LEAST_TURN_RAD or abs(turned_rad) <= TURN_SPREADS * learning.wave_spread_rad(n):
        return
    x[HEADING] += turned_rad
    x[FLOAT] += turned_rad
    x[WAVE] -= turned_rad
    kalman.add_covariance(c.p, RATE, RATE, TURN_RATE_RAD_S * TURN_RATE_RAD_S)
    for row, column in ((BIAS, BIAS), (BIAS_MEAN, BIAS), (BIAS_MEAN, BIAS_MEAN)):
        kalman.add_covariance(c.p, row, column, TURN_BIAS_RAD * TURN_BIAS_RAD)
    w[SLOW_WAVE] = 0.0


@compiled
def correct_heading(f: Filter, c: Covariance, model: Floats, t_s: float, heading_rad: float) -> None:
    """Update by a true heading."""
    w = f.w
    if w[STARTED] == 0.0 or t_s - w[T] > LONGEST_SILENCE_S:
        start(f, c.p, t_s, heading_rad)
        learning.expect_float(f.n, model[0])
        return
    if w[T] - t_s > LATEST_S:
        return
    predict_to(f, c, model, t_s)
    kalman.show_heading(c)
    taken = expect_heading(f, c, t_s, heading_rad)
    if taken:
        correct(f, c)
        learn_from_heading(f, c, t_s)
    if finish(f, c):
        note_heading(f, c, t_s, taken)


@compiled
def expect_heading(f: Filter, c: Covariance, t_s: float, heading_rad: float) -> bool:
    """Fill innovation and variances of a heading; return whether it is within the innovation gate."""
    x, late_s = f.x, f.w[T] - t_s
    expected_rad = x[FLOAT] + x[WAVE]
    if late_s > 0.0:
        expected_rad -= late_s * (x[FLOAT_RATE] + x[WAVE_RATE])
    innovation_rad = wrap_pi(heading_rad - expected_rad)
    variance = c.shown[FLOAT] + c.shown[WAVE] + math.exp(f.n[LOG_NOISE])
    limited = innovation_rad / HEADING_LIMIT
    c.innovation, c.expected, c.variance = innovation_rad, variance, max(variance, limited * limited)
    return not abs(innovation_rad) > max(GATE_SIGMAS * math.sqrt(variance), GATE_RAD)


@compiled
def learn_from_heading(f: Filter, c: Covariance, t_s: float) -> None:
    """Learn from the innovation of a heading."""
    last_s, variance = f.w[SAMPLE_T], c.expected
    step_s = 0.0 if math.isnan(last_s) else t_s - last_s
    if not step_s > 0.0:
        return
    x, n, p = f.x, f.n, c.p
    noise_square = math.exp(n[LOG_NOISE])
    learning.learn_frequencies(n, c.innovation, variance, c.shown[STATES], c.shown[STATES + 1], step_s)
    omega_rad_s = math.exp(n[LOG_OMEGA])
    rate_square = (x[WAVE_RATE] * x[WAVE_RATE] + p[WAVE_RATE, WAVE_RATE]) / (omega_rad_s * omega_rad_s)
    swing_square = 0.5 * (x[WAVE] * x[WAVE] + p[WAVE, WAVE] + rate_square)
    learning.learn_from_heading(n, c.innovation, variance, noise_square, step_s, swing_square)
    give_turn_back(f, c, step_s)


@compiled
def note_heading(f: Filter, c: Covariance, t_s: float, taken: bool) -> None:
    """Note a heading that has been taken or refused."""
    w = f.w
    w[INNOVATION] = c.innovation
    if taken:
        w[SAMPLE_T] = t_s if math.isnan(w[SAMPLE_T]) else max(t_s, w[SAMPLE_T])
        w[REFUSALS], w[INNOVATION_SD] = 0.0, math.sqrt(c.expected)
    else:
        w[REFUSALS] += 1.0


@compiled
def predict_heading(f: Filter, model: Floats, t_s: float) -> tuple[float, float]:
    """Return heading and yaw rate carried to t_s by the K-T equation alone."""
    step_s = clamp(t_s - f.w[T], 0.0, LONGEST_SILENCE_S)
    turned = kalman.turn(f.x, f.w[RUDDER], step_s, model, 0.0)
    return wrap_two_pi(turned[kalman.TURNED]), turned[kalman.TURN_RATE]
