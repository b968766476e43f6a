"""Logs of the delivered helm, sailed by its twin: what is told of K and T where an autopilot steered."""

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import KtModel
from hil.lab.identify.identify import identify
from hil.lab.identify.recording import Recording
from hil.lab.identify.stretch import Timing
from hil.lab.numeric_core import LawSettings
from hil.lab.twin import sailing
from hil.lab.twin.loop import SHOWN_RAD, TICK_S
from hil.lab.twin.sea import sea_of
from hil.ship.scenarios import sea_of as scenario_of
from hil.sim.goals import parse_goals
from hil.sim.truth import ROWS_PER_SECOND

SEEDS, WITHIN = 10, 1.96


def logged(sea, seed, hours, minutes, *, waves):
    """Return the log of each second with another course every so many minutes, K, and T; no waves: the truth."""
    told, source, heading, seconds = ParameterSet(), np.random.default_rng(seed), 0.0, 3600.0 * hours
    model = KtModel(told["MDL_K"], told["MDL_T_S"], told["MDL_ALPHA_S2"], 0.0, told["MDL_SPEED"])
    goals = []
    for number in range(round(60 * hours / minutes)):
        goals.append(f"{60 * number * minutes}:{heading:.0f}")
        heading = (heading + source.choice([-40.0, 40.0]) * source.uniform(0.5, 1.5) + 180.0) % 360.0 - 180.0
    scenario = scenario_of(sea)
    waters, task = sea_of(scenario, seed, seconds, model), sailing.task_of(parse_goals(",".join(goals)))
    record, count = sailing.sail(sailing.boat_of(told), LawSettings.of(told), waters, task, seconds)
    ticks = record.ticks[:count:ROWS_PER_SECOND]
    ticks = ticks[np.isfinite(ticks[:, SHOWN_RAD])]
    time, grid = ticks[:, TICK_S], np.arange(record.rudder_rad.size) / ROWS_PER_SECOND
    rudder, low = (np.interp(time, grid, column) for column in (record.rudder_rad, record.heading_rad))
    faster = scenario.speed_m_s / model.speed_m_s
    seen = ticks[:, SHOWN_RAD] if waves else low
    return Recording("twin", time, rudder, seen, None, None), model.turning_ability_1_s * faster, (
        model.turning_lag_s / faster
    )  # fmt: skip


@pytest.mark.proof
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("sea", "hours", "minutes", "waves"),
    [("sea", 3, 2, True), ("ocean-2", 3, 2, True), ("sea", 12, 10, False), ("ocean-2", 3, 5, False)],
)
def test_what_is_told_of_an_autopilot_s_log_holds(sea, hours, minutes, waves):
    """T was up to eleven standard errors off, a third too short, in three seeds of four."""
    off = []
    for seed in range(1, SEEDS + 1):
        recording, gain, lag = logged(sea, seed, hours, minutes, waves=waves)
        found = identify([recording])
        assert found.choice.timing.timing is Timing.RAMP
        estimates = found.judgement.estimates
        off.append([(estimates[name].value - true) / estimates[name].se for name, true in (("K", gain), ("T", lag))])
        for name, true in (("K", gain), ("T", lag)):
            if estimates[name].verdict == "identifiable":
                assert abs(estimates[name].value / true - 1.0) < 0.15, (seed, name)
    assert (np.abs(off) < WITHIN).mean() >= 0.9
