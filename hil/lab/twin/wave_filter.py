"""Twin of firmware_py/estimate/wave_filter.py, over_ground.py and wave_filter_state.py."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.tune.twins import clamp, wrap_pi, wrap_two_pi
from hil.lab.twin import kalman, learning
from hil.lab.twin.kalman import (
    BIAS,
    COLUMNS,
    COURSE_LAG,
    EAST,
    FACTOR,
    FLOAT,
    FLOAT_RATE,
    HEADING,
    NORTH,
    ORBIT_EAST,
    ORBIT_NORTH,
    RATE,
    SPEED,
    STATES,
    WAVE,
    WAVE_RATE,
    Floats,
)  # fmt: skip
from hil.lab.twin.learning import (
    LOG_BIAS,
    LOG_FOLLOW,
    LOG_NOISE,
    LOG_OMEGA,
    LOG_ORBIT,
    LOG_POWER,
    NOISES,
)  # fmt: skip

FIRST_NOISES = learning.FIRST
LONGEST_STEP_S, LONGEST_SILENCE_S, LATEST_S = 1.0, 600.0, 1.0
LOW_FACTOR, HIGH_FACTOR = 0.4, 2.5
LOW_SPEED_M_S, HIGH_SPEED_M_S = 0.08, 2.5
GATE_SIGMAS, GATE_RAD = 6.0, radians(20.0)
HEADING_LIMIT = 5.0
SWING_PERIODS, LEAST_TURN_RAD, TURN_SPREADS = 4.0, radians(15.0), 0.6
TURN_RATE_RAD_S, TURN_BIAS_RAD = radians(2.0), radians(20.0)
FIRST_COURSE_LAG_S, TOGETHER = 0.5, 0.98
WHITE = np.array(
    (
        *(0.0, 1e-6 * radians(1.0) ** 2, 0.0, 0.0, 0.1 * radians(1.0) ** 2),
        *(5e-7, 5e-7),
        *(1e-5, 1e-6, 1e-7, 0.0),
    )
)
FIRST = np.array(
    (
        *(radians(30.0), radians(1.0), radians(5.0), radians(30.0), radians(1.0)),
        *(0.2, 0.2, 0.4, 0.2, radians(5.0), 0.7),
        *(radians(10.0), radians(8.0), 0.1, 0.1, 0.1, 0.1),
    )
)

# Columns of what else the filter keeps; NaN stands for None.
(T, RUDDER, SAMPLE_T, FIX_T, REFUSALS, INNOVATION, INNOVATION_SD, WATER_NORTH, WATER_EAST, WATER_SPEED, LEG,
 STARTED, SLOW_WAVE) = range(13)  # fmt: skip
REST = 13


class WaveFilter(NamedTuple):
    """State x (17), covariance and slopes p (17 x 19), noise model n, the rest w, and room to work in."""

    x: Floats
    p: Floats
    n: Floats
    w: Floats
    once: Floats
    turned_over: Floats
    twice: Floats
    shown: Floats


@compiled
def forget(f: WaveFilter) -> None:
    """Be a filter before its first heading again; what the water is expected to be, and the rudder, stay."""
    w = f.w
    w[STARTED] = w[T] = w[REFUSALS] = w[INNOVATION] = w[INNOVATION_SD] = w[SLOW_WAVE] = 0.0
    w[SAMPLE_T] = w[FIX_T] = w[LEG] = np.nan
    for i in range(NOISES):
        f.n[i] = FIRST_NOISES[i]


@compiled
def begin_anew(f: WaveFilter) -> None:
    """Forget all but the water."""
    if f.w[STARTED] > 0.0:
        f.w[WATER_NORTH], f.w[WATER_EAST], f.w[WATER_SPEED] = f.x[NORTH], f.x[EAST], f.x[SPEED]
    f.w[RUDDER] = 0.0
    forget(f)


@compiled
def new_filter(speed_m_s: float) -> WaveFilter:
    """Return a filter before its first heading."""
    f = WaveFilter(
        np.zeros(STATES),
        np.zeros((STATES, COLUMNS)),
        np.zeros(NOISES),
        np.zeros(REST),
        np.zeros((STATES, COLUMNS)),
        np.zeros((STATES, STATES)),
        np.zeros((STATES, STATES)),
        np.zeros(COLUMNS),
    )
    f.w[WATER_SPEED] = speed_m_s
    forget(f)
    return f


@compiled
def start(f: WaveFilter, t_s: float, heading_rad: float) -> None:
    """Begin with a heading."""
    x, p, w = f.x, f.p, f.w
    if w[STARTED] > 0.0:
        w[WATER_NORTH], w[WATER_EAST], w[WATER_SPEED] = x[NORTH], x[EAST], x[SPEED]
    for i in range(STATES):
        x[i] = 0.0
    x[HEADING] = x[FLOAT] = heading_rad
    x[NORTH], x[EAST] = w[WATER_NORTH], w[WATER_EAST]
    x[SPEED], x[FACTOR] = clamp(w[WATER_SPEED], LOW_SPEED_M_S, HIGH_SPEED_M_S), 1.0
    x[COURSE_LAG] = FIRST_COURSE_LAG_S
    for i in range(STATES):
        for k in range(COLUMNS):
            p[i, k] = 0.0
        p[i, i] = FIRST[i] * FIRST[i]
    both = TOGETHER * FIRST[HEADING] * FIRST[FLOAT]
    p[HEADING, FLOAT] = p[FLOAT, HEADING] = both
    w[T], w[SAMPLE_T] = t_s, t_s
    w[RUDDER] = w[REFUSALS] = w[INNOVATION] = w[INNOVATION_SD] = w[SLOW_WAVE] = 0.0
    w[FIX_T] = w[LEG] = np.nan
    w[STARTED] = 1.0


@compiled
def bound(x: Floats) -> None:
    """Keep speed and turning factor within what a boat can have."""
    speed_m_s, factor = x[SPEED], x[FACTOR]
    if LOW_SPEED_M_S <= speed_m_s <= HIGH_SPEED_M_S and LOW_FACTOR <= factor <= HIGH_FACTOR:
        return
    x[SPEED] = clamp(speed_m_s, LOW_SPEED_M_S, HIGH_SPEED_M_S)
    x[FACTOR] = clamp(factor, LOW_FACTOR, HIGH_FACTOR)


@compiled
def predict_to(f: WaveFilter, model: tuple[float, float, float, float], t_s: float) -> None:
    """Carry everything to t_s; an earlier time changes nothing."""
    w = f.w
    while True:
        way_s = t_s - w[T]
        if not way_s > 0.0:
            return
        step_s = min(way_s, LONGEST_STEP_S)
        predict(f, model, step_s)
        w[T] = t_s if step_s == way_s else w[T] + step_s


@compiled
def predict(f: WaveFilter, model: tuple[float, float, float, float], step_s: float) -> None:
    """Carry everything on by a step."""
    x, p, n, w = f.x, f.p, f.n, f.w
    omega_rad_s, follow_rad_s = math.exp(n[LOG_OMEGA]), math.exp(n[LOG_FOLLOW])
    wave = kalman.response(omega_rad_s, kalman.DAMPING, step_s)
    turned = kalman.turn(x, w[RUDDER], step_s, model, p[BIAS, BIAS])
    follow = kalman.response(follow_rad_s, kalman.FLOAT_DAMPING, step_s)
    yaw = kalman.wave_noise(wave, omega_rad_s, math.exp(n[LOG_POWER]))
    orbit = kalman.wave_noise(wave, omega_rad_s, learning.power_of(math.exp(0.5 * n[LOG_ORBIT]), omega_rad_s))
    kalman.predict(p, f.once, f.turned_over, f.twice, turned, follow, wave)
    for i in range(WAVE):
        noise = WHITE[i] * step_s
        if i == BIAS:
            noise = math.exp(n[LOG_BIAS]) * step_s
        elif i == FLOAT_RATE:
            noise *= follow_rad_s * follow_rad_s
        p[i, i] += noise
    for place, (angle, both, rate) in ((WAVE, yaw), (ORBIT_NORTH, orbit), (ORBIT_EAST, orbit)):
        p[place, place] += angle
        p[place + 1, place + 1] += rate
        p[place, place + 1] += both
        p[place + 1, place] += both
    for place in (WAVE, ORBIT_NORTH, ORBIT_EAST):
        force = -2.0 * omega_rad_s * (omega_rad_s * x[place] + kalman.DAMPING * x[place + 1])
        p[place, STATES] += 0.5 * step_s * step_s * force
        p[place + 1, STATES] += step_s * force
    behind = x[FLOAT] - 0.5 * (x[HEADING] + turned[kalman.TURNED])
    force = -2.0 * follow_rad_s * (follow_rad_s * behind + kalman.FLOAT_DAMPING * x[FLOAT_RATE])
    p[FLOAT, STATES + 1] += 0.5 * step_s * step_s * force
    p[FLOAT_RATE, STATES + 1] += step_s * force
    kalman.advance(x, turned, follow, wave)
    bound(x)


@compiled
def take(f: WaveFilter, innovation: float, variance: float) -> None:
    """Correct by a measurement, of which `shown` says how it shows the states and the slopes."""
    shown = f.shown
    kalman.correct(f.x, f.p, shown, innovation, variance)
    bound(f.x)
    for i in range(STATES):
        part = shown[i] / variance
        f.p[i, STATES] -= part * shown[STATES]
        f.p[i, STATES + 1] -= part * shown[STATES + 1]


@compiled
def finish(f: WaveFilter) -> bool:
    """Bring the heading within a turn; numbers that are none start the filter anew."""
    x, p = f.x, f.p
    total = 0.0
    sound = True
    for i in range(STATES):
        total += x[i]
        for k in range(STATES):
            total += p[i, k]
        sound = sound and p[i, i] > 0.0
    if not (sound and math.isfinite(total)):
        forget(f)
        return False
    heading_rad = wrap_two_pi(x[HEADING])
    turns_rad = heading_rad - x[HEADING]
    x[HEADING] = heading_rad
    x[FLOAT] = x[FLOAT] + turns_rad
    return True


@compiled
def give_turn_back(f: WaveFilter, step_s: float) -> None:
    """Follow the mean of the waves' yaw, and take from them what is a turn."""
    x, p, n, w = f.x, f.p, f.n, f.w
    part = min(math.exp(n[LOG_OMEGA]) * step_s / (2.0 * math.pi * SWING_PERIODS), 0.5)
    turned_rad = w[SLOW_WAVE] + part * (x[WAVE] - w[SLOW_WAVE])
    w[SLOW_WAVE] = turned_rad
    if abs(turned_rad) <= LEAST_TURN_RAD or abs(turned_rad) <= TURN_SPREADS * learning.wave_spread_rad(n):
        return
    x[HEADING] += turned_rad
    x[FLOAT] += turned_rad
    x[WAVE] -= turned_rad
    p[RATE, RATE] += TURN_RATE_RAD_S * TURN_RATE_RAD_S
    p[BIAS, BIAS] += TURN_BIAS_RAD * TURN_BIAS_RAD
    w[SLOW_WAVE] = 0.0


@compiled
def correct_heading(f: WaveFilter, model: tuple[float, float, float, float], t_s: float, heading_rad: float) -> None:
    """Take one true heading in."""
    x, p, n, w, shown = f.x, f.p, f.n, f.w, f.shown
    if w[STARTED] == 0.0 or t_s - w[T] > LONGEST_SILENCE_S:
        start(f, t_s, heading_rad)
        return
    late_s = w[T] - t_s
    if late_s > LATEST_S:
        return
    predict_to(f, model, t_s)
    expected_rad = x[FLOAT] + x[WAVE]
    if late_s > 0.0:
        expected_rad -= late_s * (x[FLOAT_RATE] + x[WAVE_RATE])
    innovation_rad = wrap_pi(heading_rad - expected_rad)
    for i in range(COLUMNS):
        shown[i] = p[FLOAT, i] + p[WAVE, i]
    variance = shown[FLOAT] + shown[WAVE] + math.exp(n[LOG_NOISE])
    deviation_rad = math.sqrt(variance)
    if abs(innovation_rad) > max(GATE_SIGMAS * deviation_rad, GATE_RAD):
        if finish(f):
            w[REFUSALS] += 1.0
            w[INNOVATION] = innovation_rad
        return
    step_s = t_s - w[SAMPLE_T] if not math.isnan(w[SAMPLE_T]) else 0.0
    limited = innovation_rad / HEADING_LIMIT
    take(f, innovation_rad, max(variance, limited * limited))
    if step_s > 0.0:
        learning.learn_frequencies(n, innovation_rad, variance, shown[STATES], shown[STATES + 1], step_s)
        angle, rate = x[WAVE], x[WAVE_RATE]
        omega_rad_s = math.exp(n[LOG_OMEGA])
        rate_square = (rate * rate + p[WAVE_RATE, WAVE_RATE]) / (omega_rad_s * omega_rad_s)
        swing_square = 0.5 * (angle * angle + p[WAVE, WAVE] + rate_square)
        learning.learn_from_heading(n, innovation_rad, variance, step_s, swing_square)
        give_turn_back(f, step_s)
    if finish(f):
        w[SAMPLE_T] = t_s if math.isnan(w[SAMPLE_T]) else max(t_s, w[SAMPLE_T])
        w[REFUSALS], w[INNOVATION], w[INNOVATION_SD] = 0.0, innovation_rad, deviation_rad


@compiled
def predict_heading(f: WaveFilter, model: tuple[float, float, float, float], t_s: float) -> tuple[float, float]:
    """Return heading and yaw rate carried to t_s by the K-T equation alone."""
    step_s = clamp(t_s - f.w[T], 0.0, LONGEST_SILENCE_S)
    turned = kalman.turn(f.x, f.w[RUDDER], step_s, model, 0.0)
    return wrap_two_pi(turned[kalman.TURNED]), turned[kalman.TURNING]
