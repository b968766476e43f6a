"""Twin of firmware_py/estimate/wave_filter.py: its steps, in all lanes that are on."""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled
from hil.lab.lane_math import fails, least, most, within, wrap_pi, wrap_two_pi
from hil.lab.lane_rows import lanes_of, put_lanes, rows
from hil.lab.lanes import any_of, where
from hil.lab.twin import kalman, learning
from hil.lab.twin.kalman import (
    BIAS,
    BIAS_MEAN,
    COLUMNS,
    FLOAT,
    FLOAT_RATE,
    HEADING,
    RATE,
    STATES,
    WAVE,
    WAVE_RATE,
    Covariances,
    Lanes,
)  # fmt: skip
from hil.lab.twin.learning import LOG_BIAS, LOG_FOLLOW, LOG_NOISE, LOG_OMEGA, LOG_ORBIT, LOG_POWER
from hil.lab.twin.wave_filter_state import (
    INNOVATION,
    INNOVATION_SD,
    NOISE,
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
def take_part(c: Covariances, on: Lanes) -> None:
    """Let lanes take part in what is done to the covariances, and the others not."""
    put_lanes(c.on, 0, where(on, 1.0, 0.0))


@compiled
def predict_to(f: Filters, c: Covariances, boats: Boats, on: Lanes) -> None:
    """Carry lanes to their times `to_s`; an earlier time changes nothing."""
    w = rows(f.w, on)
    while True:
        to_s = lanes_of(c.to_s, 0)
        way_s = to_s - w[T]
        moved = on & (way_s > 0.0)
        if not any_of(moved):
            return
        step_s = least(way_s, LONGEST_STEP_S)
        predict(f, c, boats, moved, step_s)
        rows(f.w, moved)[T] = where(step_s == way_s, to_s, w[T] + step_s)
        take_part(c, moved)
        kalman.predict(c)


@compiled
def predict(f: Filters, c: Covariances, boats: Boats, on: Lanes, step_s: Lanes) -> None:
    """Carry the states on by a step, and fill what carries the covariances on."""
    x, n, w = rows(f.x, on), rows(f.n, on), rows(f.w, on)
    omega_rad_s, follow_rad_s = exp_of(f, OMEGA, n[LOG_OMEGA]), math.exp(n[LOG_FOLLOW])
    wave = kalman.response(omega_rad_s, kalman.DAMPING, step_s)
    turned = kalman.turn(x, w[RUDDER], step_s, boats.model, lanes_of(c.p, BIAS * COLUMNS + BIAS))
    follow = kalman.response(follow_rad_s, kalman.FLOAT_DAMPING, step_s)
    yaw = kalman.wave_noise(wave, omega_rad_s, math.exp(n[LOG_POWER]))
    orbit_m_s = exp_of(f, ORBIT, 0.5 * n[LOG_ORBIT])
    orbit = kalman.wave_noise(wave, omega_rad_s, learning.power_of(orbit_m_s, omega_rad_s))
    keep = math.exp(-step_s / kalman.BIAS_MEMORY_S)
    kalman.set_transition(c, turned, follow, wave, keep)
    noise, both, force = rows(c.noise, on), rows(c.both, on), rows(c.force, on)
    for i in range(WAVE):
        noise[i] = WHITE[i] * step_s
    noise[BIAS] = math.exp(n[LOG_BIAS]) * step_s
    noise[FLOAT_RATE] = noise[FLOAT_RATE] * least(follow_rad_s * follow_rad_s, FLOAT_WANDERS)
    for number, (angle, covariance, rate) in enumerate((yaw, orbit, orbit)):
        place = WAVE + 2 * number
        noise[place], noise[place + 1], both[number] = angle, rate, covariance
        pull = -2.0 * omega_rad_s * (omega_rad_s * x[place] + kalman.DAMPING * x[place + 1])
        force[2 * number], force[2 * number + 1] = 0.5 * step_s * step_s * pull, step_s * pull
    behind = x[FLOAT] - 0.5 * (x[HEADING] + turned[kalman.TURNED])
    pull = -2.0 * follow_rad_s * (follow_rad_s * behind + kalman.FLOAT_DAMPING * x[FLOAT_RATE])
    force[6], force[7] = 0.5 * step_s * step_s * pull, step_s * pull
    kalman.advance(x, turned, follow, wave, keep)
    bound(x)


@compiled
def take(f: Filters, c: Covariances, on: Lanes) -> None:
    """Correct by a measurement, of which `shown` says how it shows the states and the slopes."""
    take_part(c, on)
    kalman.correct(c)
    x = rows(f.x, on)
    for i in range(STATES):
        x[i] = x[i] + lanes_of(c.moved, i)
    bound(x)


@compiled
def finish(f: Filters, c: Covariances, on: Lanes) -> Lanes:
    """Bring headings within a turn; numbers that are none, as kalman.add_up saw them, start a filter anew.

    Return the lanes that go on.
    """
    x = rows(f.x, on)
    total = lanes_of(c.total, 0)
    for i in range(STATES):
        total = total + x[i]
    sound = (lanes_of(c.least, 0) > 0.0) & math.isfinite(total)
    if any_of(on & fails(sound)):
        forget(f, on & fails(sound))
    x = rows(f.x, on & sound)
    heading_rad = wrap_two_pi(x[HEADING])
    turns_rad = heading_rad - x[HEADING]
    x[HEADING] = heading_rad
    x[FLOAT] = x[FLOAT] + turns_rad
    return on & sound


@compiled
def give_turn_back(f: Filters, c: Covariances, on: Lanes, step_s: Lanes) -> None:
    """Follow the mean of the waves' yaw, and take from them what is a turn."""
    x, n, w = rows(f.x, on), rows(f.n, on), rows(f.w, on)
    part = least(exp_of(f, OMEGA, n[LOG_OMEGA]) * step_s / (2.0 * math.pi * SWING_PERIODS), 0.5)
    turned_rad = w[SLOW_WAVE] + part * (x[WAVE] - w[SLOW_WAVE])
    w[SLOW_WAVE] = turned_rad
    large = on & fails(abs(turned_rad) <= LEAST_TURN_RAD)
    if not any_of(large):
        return
    turns = large & fails(abs(turned_rad) <= TURN_SPREADS * learning.wave_spread_rad(n))
    x, p, w = rows(f.x, turns), rows(c.p, turns), rows(f.w, turns)
    x[HEADING], x[FLOAT], x[WAVE] = x[HEADING] + turned_rad, x[FLOAT] + turned_rad, x[WAVE] - turned_rad
    place = RATE * COLUMNS + RATE
    p[place] = p[place] + TURN_RATE_RAD_S * TURN_RATE_RAD_S
    for place in (kalman.place(BIAS, BIAS), kalman.place(BIAS_MEAN, BIAS), kalman.place(BIAS_MEAN, BIAS_MEAN)):
        p[place] = p[place] + TURN_BIAS_RAD * TURN_BIAS_RAD
    w[SLOW_WAVE] = 0.0


@compiled
def correct_headings(f: Filters, c: Covariances, boats: Boats, on: Lanes) -> None:
    """Take true headings, each a `sample` of its time `to_s`, in."""
    w, t_s = rows(f.w, on), lanes_of(c.to_s, 0)
    starts = on & ((w[STARTED] == 0.0) | (t_s - w[T] > LONGEST_SILENCE_S))
    if any_of(starts):
        start(f, c, starts, t_s, lanes_of(c.sample, 0))
        learning.expect_float(rows(f.n, starts), boats.model[0])
    seen = on & fails(starts | (w[T] - t_s > LATEST_S))
    predict_to(f, c, boats, seen)
    kalman.show_heading(c)
    taken = seen & expect_heading(f, c, seen)
    take(f, c, taken)
    learn_from(f, c, taken)
    kalman.add_up(c)
    finish_heading(f, c, seen, taken)


@compiled
def expect_heading(f: Filters, c: Covariances, on: Lanes) -> Lanes:
    """Fill innovations and variances of headings; return which are to be taken, as those beyond the gate are not."""
    x, n, w = rows(f.x, on), rows(f.n, on), rows(f.w, on)
    late_s, expected_rad = w[T] - lanes_of(c.to_s, 0), x[FLOAT] + x[WAVE]
    earlier_rad = expected_rad - late_s * (x[FLOAT_RATE] + x[WAVE_RATE])
    expected_rad = where(late_s > 0.0, earlier_rad, expected_rad)
    innovation_rad = wrap_pi(lanes_of(c.sample, 0) - expected_rad)
    variance = lanes_of(c.shown, FLOAT) + lanes_of(c.shown, WAVE) + exp_of(f, NOISE, n[LOG_NOISE])
    limited = innovation_rad / HEADING_LIMIT
    put_lanes(c.innovation, 0, innovation_rad)
    put_lanes(c.expected, 0, variance)
    put_lanes(c.variance, 0, most(variance, limited * limited))
    return fails(abs(innovation_rad) > most(GATE_SIGMAS * math.sqrt(variance), GATE_RAD))


@compiled
def learn_from(f: Filters, c: Covariances, on: Lanes) -> None:
    """Learn from the innovations of headings that have been taken in."""
    to_s, last_s = lanes_of(c.to_s, 0), rows(f.w, on)[SAMPLE_T]
    innovation_rad, variance = lanes_of(c.innovation, 0), lanes_of(c.expected, 0)
    step_s = where(math.isnan(last_s), 0.0, to_s - last_s)
    on = on & (step_s > 0.0)
    x, n = rows(f.x, on), rows(f.n, on)
    noise_square = exp_of(f, NOISE, n[LOG_NOISE])
    by_omega, by_follow = lanes_of(c.shown, STATES), lanes_of(c.shown, STATES + 1)
    learning.learn_frequencies(n, innovation_rad, variance, by_omega, by_follow, step_s)
    angle, rate = x[WAVE], x[WAVE_RATE]
    omega_rad_s = exp_of(f, OMEGA, n[LOG_OMEGA])
    rate_square = (rate * rate + lanes_of(c.p, WAVE_RATE * COLUMNS + WAVE_RATE)) / (omega_rad_s * omega_rad_s)
    swing_square = 0.5 * (angle * angle + lanes_of(c.p, WAVE * COLUMNS + WAVE) + rate_square)
    learning.learn_from_heading(n, innovation_rad, variance, noise_square, step_s, swing_square)
    give_turn_back(f, c, on, step_s)


@compiled
def finish_heading(f: Filters, c: Covariances, seen: Lanes, taken: Lanes) -> None:
    """Note headings that have been taken in, or have been refused."""
    sound = finish(f, c, seen)
    w, to_s = rows(f.w, sound), lanes_of(c.to_s, 0)
    w[INNOVATION] = lanes_of(c.innovation, 0)
    sample_s = where(math.isnan(w[SAMPLE_T]), to_s, most(to_s, w[SAMPLE_T]))
    w[SAMPLE_T] = where(taken, sample_s, w[SAMPLE_T])
    w[REFUSALS] = where(taken, 0.0, w[REFUSALS] + 1.0)
    w[INNOVATION_SD] = where(taken, math.sqrt(lanes_of(c.expected, 0)), w[INNOVATION_SD])


@compiled
def predict_heading(f: Filters, boats: Boats, on: Lanes, t_s: Lanes) -> tuple[Lanes, Lanes]:
    """Return heading and yaw rate carried to t_s by the K-T equation alone."""
    step_s = within(t_s - rows(f.w, on)[T], 0.0, LONGEST_SILENCE_S)
    turned = kalman.turn(rows(f.x, on), rows(f.w, on)[RUDDER], step_s, boats.model, 0.0)
    return wrap_two_pi(turned[kalman.TURNED]), turned[kalman.TURN_RATE]
