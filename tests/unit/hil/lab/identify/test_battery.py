"""Boats of every kind, badly recorded: where the verdict says identifiable, the truth is near."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hil.lab.identify import report
from hil.lab.identify.identify import identify
from hil.lab.identify.suggest import suggest

FEW = 4.0  # standard errors

# name: K, T, alpha, delta0; interval, rows; rudder [its unit], leg, slew; heading and yaw rate noise [deg]; channels
BOATS = {
    "the paper's": ((0.049, 4.0, 17.0, 0.0), (0.1, 3000), (0.35, 12.0, 0.5), (0.3, 0.1), "hr"),
    "tanker": ((0.01, 4000.0, 0.0, 0.0), (10.0, 3000), (0.35, 12000.0, 0.04), (0.1, 0.001), "hr"),
    "bent tanker": ((0.02, 200.0, 2e4, 0.0), (1.0, 5000), (0.35, 600.0, 0.05), (0.1, 0.01), "hr"),
    "quick": ((6.0, 0.2, 0.0, 0.0), (0.1, 2000), (0.35, 1.0, 0.5), (0.3, 2.0), "hr"),
    "quick at 1 Hz": ((6.0, 0.2, 0.0, 0.0), (1.0, 2000), (0.35, 7.0, 0.5), (0.3, 2.0), "hr"),
    "thrusters": ((0.0012, 1.5, 0.5, 20.0), (0.1, 3000), (500.0, 6.0, 1e9), (0.3, 1.0), "hr"),
    "stiff": ((0.5, 4.0, 1e5, 0.0), (0.1, 4000), (0.35, 12.0, 0.5), (0.3, 0.1), "hr"),
    "stiffest": ((0.5, 4.0, 1e8, 0.0), (0.1, 4000), (0.35, 12.0, 0.5), (0.05, 0.01), "hr"),
    "the wrong way": ((-0.3, 8.0, 400.0, 0.05), (0.1, 3000), (0.35, 24.0, 0.5), (0.3, 0.1), "hr"),
    "heading alone": ((0.3, 3.0, 30.0, 0.02), (0.1, 3000), (0.35, 9.0, 0.5), (0.3, 0.1), "h"),
    "yaw rate alone": ((0.1, 5.0, 50.0, 0.02), (0.1, 3000), (0.35, 15.0, 0.5), (0.3, 0.1), "r"),
    "lost in noise": ((0.01, 5.0, 0.0, 0.0), (0.1, 3000), (0.35, 15.0, 0.5), (60.0, 30.0), "hr"),
    "too short for T": ((0.05, 500.0, 0.0, 0.0), (0.5, 400), (0.35, 20.0, 0.5), (0.3, 0.1), "hr"),
}
LONGER = (
    "bent tanker",
    "quick",
    "quick at 1 Hz",
    "thrusters",
    "stiff",
    "heading alone",
    "too short for T",
    "stiffest",
)  # others show nearly the same


def make(yard, name, *, held=False):
    values, (interval, rows), (angle, leg, slew), (noise, rate_noise), channels = BOATS[name]
    boat, time = yard.boat(*values), np.arange(rows) * interval
    rudder = yard.steps(time, angle, leg, slew)
    heading, rate = boat.motion(time, rudder, held=held)
    return boat, yard.recorded(time, rudder, heading, rate, noise=noise, rate_noise=rate_noise, channels=channels)


def check(boat, found, few=FEW):
    """Everything finite and sayable, and what is called identifiable near the truth."""
    suggestion = suggest(found.fit, found.judgement)
    data = json.loads(report.as_json(found, 0.0, suggestion))
    assert report.as_text(found, suggestion)
    for name, true in boat.values().items():
        one = data[name]
        assert np.isfinite(one["value"])
        assert one["se"] >= 0.0
        if one["verdict"] == "identifiable":
            assert abs(one["value"] - true) <= few * one["se"] + 1e-4 * abs(true), (name, one, true)
    if data["alpha"]["verdict"] == "identifiable":
        assert data["K"]["verdict"] == data["T"]["verdict"] == "identifiable"
    ratio = data["K_over_T"]
    if ratio["verdict"] == "identifiable":
        assert abs(ratio["value"] - boat.gain / boat.lag) <= few * ratio["se"] + 2e-4 * abs(boat.gain / boat.lag)
    return data


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.proof] if name in LONGER else []) for name in BOATS]
)
def test_a_verdict_holds(yard, name):
    boat, recording = make(yard, name, held=name == "thrusters")
    data = check(boat, identify([recording]))
    expected = {
        "lost in noise": ("not identifiable", "not identifiable"),
        "too short for T": ("only the ratio K/T is identifiable",) * 2,
        "stiffest": ("only the ratio K/T is identifiable",) * 2,
    }
    verdicts = (data["K"]["verdict"], data["T"]["verdict"])
    assert verdicts == expected.get(name, ("identifiable", "identifiable"))
    # Nothing but a heading tells a gyroscope's constant error from a rudder offset.
    assert ("includes the gyroscope's constant error" in data["delta0"]["why"]) == (name == "yaw rate alone")


def broken(recording, kind):
    """Return a recording as bad loggers make it."""
    source, rows = np.random.default_rng(5), recording.time_s.size
    heading, rate = recording.heading_rad.copy(), recording.yaw_rate_rad_s.copy()
    if kind == "wrapped":
        return replace(recording, heading_rad=np.mod(heading, 2.0 * np.pi))
    if kind == "coarse":
        return replace(recording, heading_rad=np.radians(np.round(np.degrees(heading))), yaw_rate_rad_s=None)
    if kind == "outliers":
        heading[source.integers(0, rows, 30)] += 2.0
        rate[source.integers(0, rows, 30)] -= 1.0
        return replace(recording, heading_rad=heading, yaw_rate_rad_s=rate)
    if kind == "biased":
        return replace(recording, heading_rad=heading + 2.0, yaw_rate_rad_s=rate + 0.005)
    keep = np.ones(rows, dtype=bool)
    if kind == "gaps":
        keep[500:700] = keep[1500:1503] = keep[2000:2600] = False
    else:
        keep = source.random(rows) > 0.3
    columns = ("time_s", "rudder_rad", "heading_rad", "yaw_rate_rad_s")
    return replace(recording, **{name: getattr(recording, name)[keep] for name in columns})


@pytest.fixture(scope="module")
def well_recorded(yard):
    boat, time = yard.boat(0.1, 5.0, 50.0, 0.03), np.arange(4000) * 0.1
    rudder = yard.steps(time, 0.35, 15.0, 0.5)
    return boat, yard.recorded(time, rudder, *boat.motion(time, rudder))


@pytest.mark.parametrize("kind", ["wrapped", "coarse", "outliers", "biased", "gaps", "rows missing"])
def test_a_bad_logger_is_seen_through(well_recorded, kind):
    boat, recording = well_recorded
    found = identify([broken(recording, kind)])
    # Where rows are missing at its corners, a straight line is not quite what the rudder did.
    data = check(boat, found, few=8.0 if kind == "rows missing" else FEW)
    assert data["K"]["verdict"] == data["T"]["verdict"] == "identifiable"
    assert abs(data["T"]["value"] / 5.0 - 1.0) < 0.05
    if kind == "outliers":
        assert data["outliers"] >= 55
    if kind == "biased":
        assert any("taken away" in note for note in data["notes"])
    if kind == "gaps":
        assert data["stretches"] == 4


@pytest.mark.parametrize(("step", "jump"), [(0.2, 1.0), (1.0, 8.0)])
def test_a_clock_that_is_set_under_way_is_seen_through(yard, step, jump):
    """By compass alone alpha and the offset were three of their standard errors off, or nothing was explained."""
    boat, time = yard.boat(0.1, 6.0, 20.0, 0.01), np.arange(round(900 / step)) * step
    plan = np.radians([20.0, -20.0, 20.0, 0.0, -10.0, 10.0, -20.0, 30.0, -30.0])
    rudder = np.interp(time, time + 1.0, plan[(time // 25.0).astype(int) % plan.size])
    recording = yard.recorded(time, rudder, *boat.motion(time, rudder), channels="h")
    data = check(boat, identify([replace(recording, time_s=time + jump * (time > 450.0))]))
    assert data["stretches"] == 2
    assert data["K"]["verdict"] == data["T"]["verdict"] == "identifiable"


@pytest.mark.parametrize(("shift", "timing"), [(0, "HELD"), pytest.param(1, "AHEAD", marks=pytest.mark.proof)])
def test_a_rudder_that_jumps_is_told_from_one_that_moves(yard, shift, timing):
    """Taken for ramps, the steps would be half an interval off, and T with them: 6 standard errors."""
    boat = yard.boat(0.049, 4.0, 17.0)
    time = np.arange(9000) * 0.1
    rudder = yard.steps(time, 0.35, 30.0, 1e9)
    heading, rate = boat.motion(time, rudder, held=True)
    recording = yard.recorded(time, rudder, heading, rate)
    rows = time.size
    logged = replace(recording, rudder_rad=np.concatenate((rudder[:shift], rudder[: rows - shift])))
    found = identify([logged], model="cubic")
    assert found.choice.timing.timing.name == timing
    check(boat, found)


def test_a_lone_start_is_not_taken_for_noise(yard):
    """Without its first rows the whitening filter could swallow the decay of a wrong initial yaw rate."""
    boat = yard.boat(0.049, 4.0, 17.0)
    time = np.arange(6000) * 0.1
    rudder = yard.zigzag(time, 0.35, 40.0)
    heading, rate = boat.motion(time, rudder)
    waves = yard.wave_yaw(time.size, 0.1, np.radians(1.5), 2.53, np.random.default_rng(0))
    found = identify([yard.recorded(time, rudder, heading + waves, rate, channels="h")])
    assert abs(found.fit.state.starts[0].yaw_rate_rad_s) < np.radians(1.5)
