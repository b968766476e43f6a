"""Gain and delay margins of the default controller, with ships that differ from its model."""

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
# Options of `--with`, which change only the ship, not the controller's model.
MISMATCHES = {
    "half the gain": "kt=0.5",
    "twice the gain": "kt=2",
    "two seconds late": "delay=2",
    "a float": "float=0.3:0.6",
    "K 30 % more and T 30 % less": "kt=1.3:0.7",
    "K 30 % less and T 30 % more": "kt=0.7:1.3",
    "three times as sluggish": "kt=1:3",
}
# Time after the turn that is ignored: five minutes, with three times the lag three times as long, because the rudder
# bias that is estimated in the turn is then wrong and needs ten minutes to recover.
TURN_S, SETTLED_S, JUDGED_S = 120.0, 300.0, 300.0
SETTLING_FACTORS = {"kt=1:3": 3.0}
MAX_RMS_RATIO = 2.0  # relative to the ship without the mismatch, in the same sea
MIN_LIMIT_DEG = 0.3  # for calm water, where the error is almost zero
GAINS = (2.0, 3.0, 4.0, 6.0, 8.0, 10.0)
DELAYS_S = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


def steady_rms_deg(sea, mismatch=None, seed=1):
    """Return the rms error [deg] over five minutes after a turn has settled; infinite for an oscillation."""
    scenario = parse_scenario(sea if mismatch is None else f"{sea}+{mismatch}")
    boat = rig.Sailing(scenario, seed, hull=rig.FineHull).get_under_way(Mode.GUIDED)
    boat.tick(SteerHeading(0.0))
    boat.run(TURN_S - boat.t_s)
    boat.tick(SteerHeading(math.radians(60.0)))
    judged_from_s = TURN_S + SETTLING_FACTORS.get(mismatch, 1.0) * SETTLED_S
    boat.run(judged_from_s + JUDGED_S - boat.t_s)
    track = np.array(boat.track)
    error_deg = np.degrees(track[track[:, 0] > judged_from_s, 3]) - 60.0
    return math.inf if boat.times_of(REPORT) else float(np.sqrt(np.mean(np.square(error_deg))))


def limit_deg(sea):
    """Return the limit for a mismatched ship in a sea, based on the error without the mismatch."""
    return max(MAX_RMS_RATIO * steady_rms_deg(sea), MIN_LIMIT_DEG)


@pytest.mark.parametrize("mismatch", ["two seconds late", pytest.param("twice the gain", marks=pytest.mark.proof)])
def test_error_with_model_mismatch_is_small_in_calm_water(mismatch):
    """By the compiled loop."""
    end_s = TURN_S + SETTLED_S + JUDGED_S
    ticks, record = voyage.sail(f"calm+{MISMATCHES[mismatch]}", 1, [(0.0, 0.0), (TURN_S, math.radians(60.0))], end_s)
    error_deg = np.degrees(record.heading_rad[round(10.0 * (TURN_S + SETTLED_S)) : round(10.0 * end_s)]) - 60.0
    assert error_deg.size > 9.9 * JUDGED_S
    assert not ticks[:, loop.OSCILLATING].any()
    assert float(np.sqrt(np.mean(np.square(error_deg)))) < MIN_LIMIT_DEG


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("sea", SEAS)
def test_error_with_model_mismatch_is_limited_in_each_sea(sea, figures):
    limit, rms_by_mismatch = limit_deg(sea), {}
    for mismatch, option in MISMATCHES.items():
        rms_by_mismatch[mismatch] = steady_rms_deg(sea, option)
        figures.keep(key_of("margins", sea, mismatch, "rms"), rms_by_mismatch[mismatch], "deg")
    print(sea, round(limit, 2), {mismatch: round(rms, 2) for mismatch, rms in rms_by_mismatch.items()})
    assert {mismatch: rms for mismatch, rms in rms_by_mismatch.items() if not rms <= limit} == {}


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("sea", SEAS)
def test_gain_and_delay_margins(sea, figures):
    """The margins are at least a factor of 2 of the gain and a delay of 2 s."""
    limit = limit_deg(sea)
    for name, unit, minimum, options in (
        ("gain", "times", 2.0, {gain: f"kt={gain:g}" for gain in GAINS}),
        ("delay", "s", 2.0, {delay: f"delay={delay:g}" for delay in DELAYS_S}),
    ):
        largest = 0.0
        for value, option in options.items():
            if not steady_rms_deg(sea, option) <= limit:
                break
            largest = value
        print(sea, name, largest)
        figures.keep(key_of("margins", sea, name), largest, unit)
        assert largest >= minimum
