"""Twin of firmware_py/estimate/wave_filter.py: its steps, in all lanes that are `on`."""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.lanes import COUNT
from hil.lab.tune.twins import clamp, wrap_pi, wrap_two_pi
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
    Covariances,
    Floats,
)  # fmt: skip
from hil.lab.twin.learning import LOG_BIAS, LOG_FOLLOW, LOG_NOISE, LOG_OMEGA, LOG_ORBIT, LOG_POWER
from hil.lab.twin.wave_filter_state import (
    INNOVATION,
    INNOVATION_SD,
    OMEGA,
    ORBIT,
    REFUSALS,
    RUDDER,
    SAMPLE_T,
    SLOW_WAVE,
    STARTED,
    Boats,
    Filters,
    T,
    WaveFilter,
    bound,
    exp_of,
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
def predict_to(filters: Filters, c: Covariances, boats: Boats) -> None:
    """Carry the lanes that are `on` to their times `to_s`; an earlier time changes nothing."""
    asked, more = 0, True
    for k in range(COUNT):
        asked += int(c.on[k] > 0.0) << k
    while more:
        more = False
        for k in range(COUNT):
            w = filters[k].w
            way_s = c.to_s[k] - w[T]
            moved = asked >> k & 1 > 0 and way_s > 0.0
            c.on[k] = 1.0 if moved else 0.0
            if moved:
                step_s = min(way_s, LONGEST_STEP_S)
                predict(filters[k], c, boats[k].model, step_s)
                w[T] = c.to_s[k] if step_s == way_s else w[T] + step_s
                more = True
        if more:
            kalman.predict(c)
    kalman.turn_on(c, asked)


@compiled
def predict(f: WaveFilter, c: Covariances, model: Floats, step_s: float) -> None:
    """Carry the states on by a step, and fill what carries the covariance on."""
    x, n, w, lane = f.x, f.n, f.w, f.lane
    omega_rad_s, follow_rad_s = exp_of(f, OMEGA, n[LOG_OMEGA]), math.exp(n[LOG_FOLLOW])
    wave = kalman.response(omega_rad_s, kalman.DAMPING, step_s)
    turned = kalman.turn(x, w[RUDDER], step_s, model, c.p[BIAS, BIAS, lane])
    follow = kalman.response(follow_rad_s, kalman.FLOAT_DAMPING, step_s)
    yaw = kalman.wave_noise(wave, omega_rad_s, math.exp(n[LOG_POWER]))
    orbit_m_s = exp_of(f, ORBIT, 0.5 * n[LOG_ORBIT])
    orbit = kalman.wave_noise(wave, omega_rad_s, learning.power_of(orbit_m_s, omega_rad_s))
    keep = math.exp(-step_s / kalman.BIAS_MEMORY_S)
    kalman.set_transition(c, lane, turned, follow, wave, keep)
    for i in range(WAVE):
        c.noise[i, lane] = WHITE[i] * step_s
    c.noise[BIAS, lane] = math.exp(n[LOG_BIAS]) * step_s
    c.noise[FLOAT_RATE, lane] *= min(follow_rad_s * follow_rad_s, FLOAT_WANDERS)
    for number, (angle, both, rate) in enumerate((yaw, orbit, orbit)):
        place = WAVE + 2 * number
        c.noise[place, lane], c.noise[place + 1, lane], c.both[number, lane] = angle, rate, both
        force = -2.0 * omega_rad_s * (omega_rad_s * x[place] + kalman.DAMPING * x[place + 1])
        c.force[2 * number, lane], c.force[2 * number + 1, lane] = 0.5 * step_s * step_s * force, step_s * force
    behind = x[FLOAT] - 0.5 * (x[HEADING] + turned[kalman.TURNED])
    force = -2.0 * follow_rad_s * (follow_rad_s * behind + kalman.FLOAT_DAMPING * x[FLOAT_RATE])
    c.force[6, lane], c.force[7, lane] = 0.5 * step_s * step_s * force, step_s * force
    kalman.advance(x, turned, follow, wave, keep)
    bound(x)


@compiled
def take(filters: Filters, c: Covariances) -> None:
    """Correct by a measurement, of which `shown` says how it shows the states and the slopes, the lanes that are on."""
    kalman.correct(c)
    for k in range(COUNT):
        if c.on[k] > 0.0:
            x = filters[k].x
            for i in range(STATES):
                x[i] = x[i] + c.moved[i, k]
            bound(x)


@compiled
def finish(f: WaveFilter, c: Covariances) -> bool:
    """Bring the heading within a turn; numbers that are none, as kalman.add_up saw them, start the filter anew."""
    x = f.x
    total = c.total[f.lane]
    for i in range(STATES):
        total += x[i]
    if not (c.least[f.lane] > 0.0 and math.isfinite(total)):
        forget(f)
        return False
    heading_rad = wrap_two_pi(x[HEADING])
    turns_rad = heading_rad - x[HEADING]
    x[HEADING] = heading_rad
    x[FLOAT] = x[FLOAT] + turns_rad
    return True


@compiled
def give_turn_back(f: WaveFilter, c: Covariances, step_s: float) -> None:
    """Follow the mean of the waves' yaw, and take from them what is a turn."""
    x, p, n, w, lane = f.x, c.p, f.n, f.w, f.lane
    part = min(exp_of(f, OMEGA, n[LOG_OMEGA]) * step_s / (2.0 * math.pi * SWING_PERIODS), 0.5)
    turned_rad = w[SLOW_WAVE] + part * (x[WAVE] - w[SLOW_WAVE])
    w[SLOW_WAVE] = turned_rad
    if abs(turned_rad) <= LEAST_TURN_RAD or abs(turned_rad) <= TURN_SPREADS * learning.wave_spread_rad(n):
        return
    x[HEADING] += turned_rad
    x[FLOAT] += turned_rad
    x[WAVE] -= turned_rad
    p[RATE, RATE, lane] += TURN_RATE_RAD_S * TURN_RATE_RAD_S
    for i in (BIAS, BIAS_MEAN):
        for k in (BIAS, BIAS_MEAN):
            p[i, k, lane] += TURN_BIAS_RAD * TURN_BIAS_RAD
    w[SLOW_WAVE] = 0.0


@compiled
def correct_headings(filters: Filters, c: Covariances, boats: Boats, heading_rad: Floats) -> None:
    """Take a true heading of the time `to_s` in, in each lane that is on."""
    for k in range(COUNT):
        f, t_s = filters[k], c.to_s[k]
        if c.on[k] > 0.0 and (f.w[STARTED] == 0.0 or t_s - f.w[T] > LONGEST_SILENCE_S):
            start(f, c, t_s, heading_rad[k])
            learning.expect_float(f.n, boats[k].model[0])
            c.on[k] = 0.0
        elif f.w[T] - t_s > LATEST_S:
            c.on[k] = 0.0
    predict_to(filters, c, boats)
    kalman.show_heading(c)
    seen = 0
    for k in range(COUNT):
        if c.on[k] > 0.0:
            seen |= 1 << k
            c.on[k] = 1.0 if expect_heading(filters[k], c, heading_rad[k]) else 0.0
    take(filters, c)
    for k in range(COUNT):
        if c.on[k] > 0.0:
            learn_from(filters[k], c)
    kalman.add_up(c)
    for k in range(COUNT):
        if seen >> k & 1 > 0:
            finish_heading(filters[k], c)


@compiled
def expect_heading(f: WaveFilter, c: Covariances, heading_rad: float) -> bool:
    """Fill innovation and variance of a heading; return whether it is to be taken, as one beyond the gate is not."""
    x, n, w, shown, lane = f.x, f.n, f.w, c.shown, f.lane
    late_s = w[T] - c.to_s[lane]
    expected_rad = x[FLOAT] + x[WAVE]
    if late_s > 0.0:
        expected_rad -= late_s * (x[FLOAT_RATE] + x[WAVE_RATE])
    innovation_rad = wrap_pi(heading_rad - expected_rad)
    variance = shown[FLOAT, lane] + shown[WAVE, lane] + math.exp(n[LOG_NOISE])
    limited = innovation_rad / HEADING_LIMIT
    c.innovation[lane], c.expected[lane], c.variance[lane] = innovation_rad, variance, max(variance, limited * limited)
    return not abs(innovation_rad) > max(GATE_SIGMAS * math.sqrt(variance), GATE_RAD)


@compiled
def learn_from(f: WaveFilter, c: Covariances) -> None:
    """Learn from the innovation of a heading that has been taken in."""
    x, p, n, w, lane = f.x, c.p, f.n, f.w, f.lane
    innovation_rad, variance = c.innovation[lane], c.expected[lane]
    step_s = c.to_s[lane] - w[SAMPLE_T] if not math.isnan(w[SAMPLE_T]) else 0.0
    if step_s > 0.0:
        by_omega, by_follow = c.shown[STATES, lane], c.shown[STATES + 1, lane]
        learning.learn_frequencies(n, innovation_rad, variance, by_omega, by_follow, step_s)
        angle, rate = x[WAVE], x[WAVE_RATE]
        omega_rad_s = exp_of(f, OMEGA, n[LOG_OMEGA])
        rate_square = (rate * rate + p[WAVE_RATE, WAVE_RATE, lane]) / (omega_rad_s * omega_rad_s)
        swing_square = 0.5 * (angle * angle + p[WAVE, WAVE, lane] + rate_square)
        learning.learn_from_heading(n, innovation_rad, variance, step_s, swing_square)
        give_turn_back(f, c, step_s)


@compiled
def finish_heading(f: WaveFilter, c: Covariances) -> None:
    """Note a heading that has been taken in, or has been refused."""
    w, lane = f.w, f.lane
    if finish(f, c):
        w[INNOVATION] = c.innovation[lane]
        if c.on[lane] > 0.0:
            w[SAMPLE_T] = c.to_s[lane] if math.isnan(w[SAMPLE_T]) else max(c.to_s[lane], w[SAMPLE_T])
            w[REFUSALS], w[INNOVATION_SD] = 0.0, math.sqrt(c.expected[lane])
        else:
            w[REFUSALS] += 1.0


@compiled
def predict_heading(f: WaveFilter, model: Floats, t_s: float) -> tuple[float, float]:
    """Return heading and yaw rate carried to t_s by the K-T equation alone."""
    step_s = clamp(t_s - f.w[T], 0.0, LONGEST_SILENCE_S)
    turned = kalman.turn(f.x, f.w[RUDDER], step_s, model, 0.0)
    return wrap_two_pi(turned[kalman.TURNED]), turned[kalman.TURNING]
