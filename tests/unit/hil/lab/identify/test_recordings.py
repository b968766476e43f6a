"""Real yachts: what is predicted of the part not seen, beside a converged scipy fit and a regression of derivatives.

The other fits share no line with ours: the linear equation's exact answer to ramps as a digital filter, the cubic one
by Runge-Kutta, scipy's least_squares, no speed.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from hil.lab.identify import report
from hil.lab.identify.identify import identify
from hil.lab.identify.manoeuvre_file import read
from hil.lab.identify.recording import Source
from hil.lab.identify.suggest import suggest
from support.paths import DATA

FOLDER = DATA / "manoeuvre"
LONG, SHORT = "yacht_avnav_20160815.csv", "yacht_gpsd_bundg_zeus.csv"
MOST = 1.05  # times the error of the better one of two converged fits
# file, train, validate
SPLITS = [
    (LONG, (0, 1000), (1000, 2020)),
    (SHORT, (70, 140), (0, 70)),
    (LONG, (1000, 2020), (0, 1000)),
    (LONG, (0, 500), (500, 1000)),
    (LONG, (500, 1000), (1000, 1500)),
    (LONG, (1000, 1500), (1500, 2020)),
    (LONG, (1500, 2020), (0, 500)),
    (LONG, (0, 1350), (1350, 2020)),
    (LONG, (300, 700), (700, 1100)),
    (LONG, (700, 1100), (300, 700)),
    (LONG, (0, 200), (200, 400)),
    (SHORT, (0, 70), (70, 140)),
    (SHORT, (0, 100), (100, 140)),
]


def simulated(recording, gain, lag, offset, start):
    """Return the yaw rate of the linear model; samples are even, the rudder ramps between them."""
    step = float(np.median(np.diff(recording.time_s)))
    x = step / lag
    keep = np.exp(-x)
    late = 1.0 - (1.0 - keep) / x
    drive = gain * (recording.rudder_rad - offset)
    forced = np.concatenate(([start], (1.0 - keep - late) * drive[:-1] + late * drive[1:]))
    return lfilter([1.0], [1.0, -keep], forced)


def output_error_fit(recording):
    rate = recording.yaw_rate_rad_s

    def errors(p):
        return simulated(recording, np.exp(p[0]), np.exp(p[1]), p[2], p[3]) - rate

    starts = [
        [np.log(k), np.log(t), recording.rudder_rad.mean(), rate[0]] for k in (0.1, 1.0) for t in (0.5, 3.0, 20.0)
    ]
    fits = [least_squares(errors, start, x_scale="jac", xtol=1e-11, ftol=1e-11) for start in starts]
    best = min(fits, key=lambda one: one.cost).x
    return np.exp(best[0]), np.exp(best[1]), best[2]


def derivative_regression(recording):
    rate = recording.yaw_rate_rad_s
    columns = np.column_stack([recording.rudder_rad, rate, np.ones(rate.size)])
    solved = np.linalg.lstsq(columns, np.gradient(rate, recording.time_s), rcond=None)[0]
    return -solved[0] / solved[1], -1.0 / solved[1], -solved[2] / solved[0]


def bent(recording, gain, lag, cubic, offset, start):
    """Return the yaw rate with Norrbin's term, by classical Runge-Kutta in half steps."""
    step = 0.5 * float(np.median(np.diff(recording.time_s)))
    rows = recording.rudder_rad.size
    rudder = np.interp(np.arange(2 * rows - 1) / 2, np.arange(rows), recording.rudder_rad)
    middle = 0.5 * (rudder[1:] + rudder[:-1])
    rate, rates = start, [start]

    def slope(r, angle):
        return (gain * (angle - offset) - r - cubic * r * r * r) / lag

    for n, (one, half, two) in enumerate(zip(rudder[:-1].tolist(), middle.tolist(), rudder[1:].tolist(), strict=True)):
        k1 = slope(rate, one)
        k2 = slope(rate + 0.5 * step * k1, half)
        k3 = slope(rate + 0.5 * step * k2, half)
        rate = min(max(rate + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(rate + step * k3, two)), -5.0), 5.0)
        if n % 2:
            rates.append(rate)
    return np.array(rates)


def bent_fit(recording, linear):
    def errors(p):
        return bent(recording, np.exp(p[0]), np.exp(p[1]), 10.0 * p[2], p[3], p[4]) - recording.yaw_rate_rad_s

    gain, lag, offset = linear
    begin = [np.log(gain), np.log(lag), 1.0, offset, recording.yaw_rate_rad_s[0]]
    bounds = ([-8.0, -3.0, -1.0, -0.5, -1.0], [8.0, 6.0, 1e3, 0.5, 1.0])
    best = least_squares(errors, begin, x_scale="jac", bounds=bounds).x
    return np.exp(best[0]), np.exp(best[1]), 10.0 * best[2], best[3]


def held_out_error(recording, model):
    def errors(start):
        motion = simulated if len(model) == 3 else bent
        return motion(recording, *model, start[0]) - recording.yaw_rate_rad_s

    return float(np.sqrt(np.mean(least_squares(errors, [recording.yaw_rate_rad_s[0]]).fun ** 2)))


def test_a_short_log_s_speed_is_not_trusted_and_a_long_one_s_is(yard):
    """Of a boat that follows similarity: what 7 s tell is too little to say so, what 10 min tell is not."""
    boat = yard.boat(0.3, 3.0)
    for rows, swing, scaled in ((70, 0.04, False), (70, 0.3, False), (6000, 0.04, True)):
        time = np.arange(rows) * 0.1
        rudder = yard.steps(time, 0.35, 6.0, 0.5)
        ratio = 1.0 + swing * np.sin(time / 3.0)
        # At a speed that hardly varies, similarity is little more than a time that runs unevenly.
        passed = np.concatenate(([0.0], np.cumsum(0.5 * (ratio[1:] + ratio[:-1]) * 0.1)))
        heading, rate = boat.motion(passed, rudder)
        recording = replace(yard.recorded(time, rudder, heading, ratio * rate, noise=1.0), speed_m_s=0.4 * ratio)
        choice = identify([recording], model="linear").choice
        assert choice.scaled is scaled
        assert ("too few to trust" in choice.speed_why) is not scaled


def sailed(time, rudder, speed, gain, lag, cubic):
    """Heading and yaw rate of a ship whose K, T, alpha follow similarity from 0.4 m/s: Runge-Kutta in small steps."""
    parts = 5
    heading, rate = np.zeros(time.size), np.zeros(time.size)
    for n in range(time.size - 1):
        step = (time[n + 1] - time[n]) / parts
        psi, r = heading[n], rate[n]
        for part in range(parts):

            def slope(x, r, n=n):
                u = (speed[n] + x * (speed[n + 1] - speed[n])) / 0.4
                angle = rudder[n] + x * (rudder[n + 1] - rudder[n])
                return (gain * u * angle - r - cubic / u**2 * r**3) / (lag / u)

            x = part / parts
            half = x + 0.5 / parts
            k1 = slope(x, r)
            k2 = slope(half, r + 0.5 * step * k1)
            k3 = slope(half, r + 0.5 * step * k2)
            k4 = slope(x + 1.0 / parts, r + step * k3)
            after = r + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            psi += 0.5 * step * (r + after)
            r = after
        heading[n + 1], rate[n + 1] = psi, r
    return heading, rate


def test_a_log_in_which_her_speed_doubles_gives_the_model_at_its_mean_speed(yard):
    time = np.arange(4000) * 0.1
    speed = 0.4 + 0.4 * time / time[-1]
    rudder = yard.steps(time, 0.35, 12.0, 0.5)
    heading, rate = sailed(time, rudder, speed, 0.049, 4.0, 17.0)
    noise = 0.02 * np.random.default_rng(1).standard_normal(time.size)
    recording = replace(yard.recorded(time, rudder, heading, rate), speed_m_s=speed + noise)
    found = identify([recording])
    assert found.choice.scaled
    data = json.loads(report.as_json(found, 0.0, suggest(found.fit, found.judgement)))
    for name, true in (("K", 0.049 * 1.5), ("T", 4.0 / 1.5)):
        assert data[name]["verdict"] == "identifiable"
        assert abs(data[name]["value"] - true) < max(4.0 * data[name]["se"], 0.01 * true)


@pytest.mark.parametrize(("cubic", "channels"), [(-400.0, "hr"), pytest.param(-2000.0, "h", marks=pytest.mark.proof)])
def test_a_ship_that_does_not_run_straight_by_herself_is_not_given_a_model(yard, cubic, channels):
    """K, T and alpha below zero: stable in a turn only."""
    time = np.arange(4000) * 0.1
    rudder = yard.steps(time, 0.35, 12.0, 0.5)
    heading, rate = sailed(time, rudder, np.full(time.size, 0.4), -0.06, -6.0, cubic)
    found = identify([yard.recorded(time, rudder, heading, rate, channels=channels)])
    data = json.loads(report.as_json(found, 0.0, suggest(found.fit, found.judgement)))
    names = ("K", "T", "alpha", "delta0")
    assert all(np.isfinite(data[name]["value"]) for name in names)
    assert {data[name]["verdict"] for name in names}.isdisjoint({"identifiable"})
    assert any("is she unstable?" in warning for warning in data["warnings"])


@pytest.mark.proof
def test_the_rudder_offset_of_a_ship_whose_turns_only_a_cube_ends_is_not_believed(yard):
    """By compass alone she may not be seen to be unstable, and the offset was 10 of its standard errors off."""
    time = np.arange(4500) * 0.2
    plan = np.radians([20.0, -20.0, 20.0, 0.0, -10.0, 10.0, -20.0, 30.0, -30.0])
    rudder = np.interp(time, time + 1.0, plan[(time // 25.0).astype(int) % plan.size])
    heading, rate = sailed(time, rudder - 0.01, np.full(time.size, 0.4), -0.1, -5.0, -6000.0)
    found = identify([yard.recorded(time, rudder, heading, rate, noise=0.5, channels="h")])
    assert {one.verdict for one in found.judgement.estimates.values()}.isdisjoint({"identifiable"})


@pytest.mark.parametrize(
    "split", [pytest.param(one, marks=[pytest.mark.proof] if number != 1 else []) for number, one in enumerate(SPLITS)]
)
def test_what_was_not_seen_is_predicted_as_well_as_by_a_converged_fit(split):
    name, train, validate = split
    if not (FOLDER / name).exists():
        pytest.skip("the recordings of tests/data are not here")
    whole = read(FOLDER / name)
    seen, unseen = (whole.part(Source(Path(name), *map(float, ends))) for ends in (train, validate))
    straight = output_error_fit(seen)
    reference = min(held_out_error(unseen, straight), held_out_error(unseen, bent_fit(seen, straight)))
    regression = held_out_error(unseen, derivative_regression(seen))
    for model in ("auto", "linear"):
        ours = identify([seen], [unseen], model=model).validate[0].yaw_rate_rmse_rad_s
        assert ours <= MOST * reference, (model, ours / reference)
        assert ours < regression
