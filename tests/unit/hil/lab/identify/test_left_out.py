"""A boat that answers later or sooner than the rudder column says, or with slack: told, and counted in K and T."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from hil.lab.identify.identify import identify

STEP = 0.1
PLAN = np.radians([20.0, -20.0, 20.0, 0.0, -10.0, 10.0, -20.0, 30.0, -30.0])


def sailed(yard, seed=0):
    """Return times, the rudder of an irregular plan, and heading and yaw rate of a known boat."""
    time = np.arange(6000) * STEP
    target, rudder = PLAN[(time // 25.0).astype(int) % PLAN.size], np.zeros(time.size)
    for n in range(1, time.size):
        rudder[n] = rudder[n - 1] + np.clip(target[n] - rudder[n - 1], -0.017, 0.017)
    return time, rudder, *yard.boat(0.1, 6.0, 20.0, 0.01).motion(time, rudder)


def off(found, true):
    """Return by how many of their standard errors K and T are off."""
    estimates = found.judgement.estimates
    return [abs(estimates[name].value - value) / estimates[name].se for name, value in true.items()]


def warnings_of(found):
    return [text for text in found.judgement.warnings if text.startswith("she answers ")]


def with_play(rudder, width):
    """Return where a blade is that what moves it has so much play to."""
    blade, at = np.zeros(rudder.size), 0.0
    for n, angle in enumerate(rudder):
        at = min(max(at, angle - 0.5 * width), angle + 0.5 * width)
        blade[n] = at
    return blade


@pytest.mark.parametrize(
    ("channels", "plan"),
    [("hr", "irregular"), ("h", "irregular"), pytest.param("hr", "zigzag", marks=pytest.mark.proof)],
)
def test_slack_of_the_rudder_is_told_and_counted(yard, channels, plan):
    """Two degrees made K 5 % too small, five of its standard errors, without a word."""
    time, rudder, _, _ = sailed(yard)
    if plan == "zigzag":
        rudder = yard.zigzag(time, np.radians(20.0), 18.0, 0.1)
    heading, rate = yard.boat(0.1, 6.0, 20.0, 0.01).motion(time, with_play(rudder, np.radians(2.0)))
    found = identify([yard.recorded(time, rudder, heading, rate, channels=channels)])
    (warning,) = warnings_of(found)
    share = float(warning.removeprefix("she answers as if ").split(" % of the rudder's swing")[0])
    assert share == pytest.approx(200.0 / np.degrees(np.ptp(rudder)), rel=0.5)
    assert max(off(found, {"K": 0.1, "T": 6.0, "delta0": 0.01})) < 2.5
    assert found.judgement.estimates["K"].verdict == "identifiable"


@pytest.mark.parametrize(("rows", "said", "channels"), [(5, "later", "hr"), (-5, "sooner", "h")])
def test_half_a_second_between_rudder_and_motion_is_told_and_counted(yard, rows, said, channels):
    """T was 18 of its standard errors off."""
    time, rudder, heading, rate = sailed(yard)
    inside = slice(5, time.size - 5)
    seen = [np.roll(values, rows)[inside] for values in (heading, rate)]
    found = identify([yard.recorded(time[inside], rudder[inside], *seen, channels=channels)])
    (warning,) = warnings_of(found)
    assert abs(float(warning.removeprefix("she answers ").split(" s ")[0]) - 0.5) < 0.1
    assert f" s {said} than" in warning
    assert max(off(found, {"K": 0.1, "T": 6.0})) < 2.0
    assert found.judgement.estimates["T"].verdict == "identifiable"


@pytest.mark.proof
def test_a_ship_with_a_second_lag_is_not_surer_of_k_and_t_than_that_allows(yard):
    """Nomoto's second order, T1 10 s, T2 2.5 s, T3 1.5 s: K was 7 of its standard errors off, T 6."""
    time, rudder, _, _ = sailed(yard)
    top, bottom, _ = cont2discrete((0.12 * np.array([1.5, 1.0]), np.array([25.0, 12.5, 1.0])), STEP, "foh")
    rate = lfilter(top.ravel(), bottom, rudder)
    heading = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * STEP)))
    found = identify([yard.recorded(time, rudder, heading, rate)])
    assert len(warnings_of(found)) == 1
    assert max(off(found, {"K": 0.12, "T": 11.0})) < 2.0


@pytest.mark.parametrize("channels", ["hr", "h"])
def test_a_boat_that_is_what_the_equation_says_is_never_called_late(yard, channels):
    time, rudder, heading, rate = sailed(yard)
    found = identify([yard.recorded(time, rudder, heading, rate, channels=channels)])
    assert not warnings_of(found)
    assert max(off(found, {"K": 0.1, "T": 6.0})) < 4.0
