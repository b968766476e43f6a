"""Margins by injection: the delivered controller in ships that differ from its model, and its limits."""

import math

import numpy as np
import pytest

from firmware_py.common.intents import SteerHeading
from firmware_py.common.mode_table import Mode
from firmware_py.faults.table import TABLE, Fault
from hil.lab.twin import loop
from hil.report.figure_file import key_of
from hil.ship.scenarios import parse_scenario
from support import rig, voyage

REPORT = TABLE[Fault.HELM_OSCILLATES].text
SEAS = ("calm", "tank", "sea", "swell", "weak")
# Options of `--with`, in the ship only; the controller's model does not change.
MISMATCHES = {
    "half the gain": "kt=0.5",
    "twice the gain": "kt=2",
    "two seconds late": "delay=2",
    "a float": "float=0.3:0.6",
    "K 30 % more and T 30 % less": "kt=1.3:0.7",
    "K 30 % less and T 30 % more": "kt=0.7:1.3",
    "three times as sluggish": "kt=1:3",
}
# Five minutes to settle after the turn, three times as long with three times the lag: the rudder centre estimated in
# the turn is wrong then, and takes ten minutes to recover.
TURN_S, SETTLED_S, JUDGED_S = 120.0, 300.0, 300.0
TIMES = {"kt=1:3": 3.0}
MAX_RMS = 2.0  # relative to the ship without the mismatch, in the same sea
LEAST_RMS_DEG = 0.3  # of flat water, where that is next to nothing
GAINS = (2.0, 3.0, 4.0, 6.0, 8.0, 10.0)
DELAYS_S = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


def steady(sea, mismatch=None, seed=1):
    """Return the rms error [deg] of five minutes after a turn has settled, infinite for an oscillation."""
    scenario = parse_scenario(sea if mismatch is None else f"{sea}+{mismatch}")
    boat = rig.Sailing(scenario, seed, hull=rig.FineHull).under_way(Mode.GUIDED)
    boat.tick(SteerHeading(0.0))
    boat.run(TURN_S - boat.t_s)
    boat.tick(SteerHeading(math.radians(60.0)))
    quiet_after_s = TURN_S + TIMES.get(mismatch, 1.0) * SETTLED_S
    boat.run(quiet_after_s + JUDGED_S - boat.t_s)
    track = np.array(boat.track)
    error_deg = np.degrees(track[track[:, 0] > quiet_after_s, 3]) - 60.0
    return math.inf if boat.times_of(REPORT) else float(np.sqrt(np.mean(np.square(error_deg))))


def limit_deg(sea):
    """Return the limit for a mismatched ship in this sea, from the error without the mismatch."""
    return max(MAX_RMS * steady(sea), LEAST_RMS_DEG)


@pytest.mark.parametrize("mismatch", ["two seconds late", pytest.param("twice the gain", marks=pytest.mark.proof)])
def test_model_mismatch_is_steady_in_flat_water(mismatch):
    """By the compiled loop."""
    end_s = TURN_S + SETTLED_S + JUDGED_S
    ticks, record = voyage.sail(f"calm+{MISMATCHES[mismatch]}", 1, [(0.0, 0.0), (TURN_S, math.radians(60.0))], end_s)
    error_deg = np.degrees(record.heading_rad[round(10.0 * (TURN_S + SETTLED_S)) : round(10.0 * end_s)]) - 60.0
    assert error_deg.size > 9.9 * JUDGED_S
    assert not ticks[:, loop.OSCILLATING].any()
    assert float(np.sqrt(np.mean(np.square(error_deg)))) < LEAST_RMS_DEG


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("sea", SEAS)
def test_model_mismatch_is_steady_in_every_sea(sea, figures):
    most_deg, found = limit_deg(sea), {}
    for mismatch, option in MISMATCHES.items():
        found[mismatch] = steady(sea, option)
        figures.keep(key_of("margins", sea, mismatch, "rms"), found[mismatch], "deg")
    print(sea, round(most_deg, 2), {mismatch: round(rms, 2) for mismatch, rms in found.items()})
    assert {mismatch: rms for mismatch, rms in found.items() if not rms <= most_deg} == {}


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("sea", SEAS)
def test_gain_and_delay_margins(sea, figures):
    """More than is asked for: twice the gain, and two seconds at 0.4 m/s."""
    most_deg = limit_deg(sea)
    for name, unit, minimum, options in (
        ("gain", "times", 2.0, {gain: f"kt={gain:g}" for gain in GAINS}),
        ("delay", "s", 2.0, {delay: f"delay={delay:g}" for delay in DELAYS_S}),
    ):
        borne = 0.0
        for size, option in options.items():
            if not steady(sea, option) <= most_deg:
                break
            borne = size
        print(sea, name, borne)
        figures.keep(key_of("margins", sea, name), borne, unit)
        assert borne >= minimum
