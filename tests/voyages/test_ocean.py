"""The default autopilot in realistic seas: the task of docs/explanation/capabilities.md with five seeds, and targets.

`pytest -m proof tests/voyages/test_ocean.py -s` simulates it in the compiled loop and prints a table: mean / worst of
the seeds. A few of the runs are repeated with the real autopilot on ptys, which has to give the same figures.
"""

import json
import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.control.law import LawSettings
from hil.lab.compare.runs import OURS, Task, truth_of
from hil.lab.compare.score import score_of, turns_of
from hil.lab.twin import sailing
from hil.lab.twin.sea import sea_of as draw_sea
from hil.report.figure_file import key_of
from hil.ship.scenarios import parse_scenario
from hil.sim.goals import parse_goals

SEEDS = (1, 2, 3, 4, 5)
MANY_SEEDS = 160  # number of seeds for the distribution of the figures
CONFIRMED_SEAS = ("swell", "weak+float=0.3:0.6", "ocean-4")  # with the first seed
RMS, TRAVEL, MEAN, OVERSHOOT, SETTLED = "rms deg", "travel deg/h", "mean deg", "overshoot deg", "settled s"
COLUMNS = (RMS, TRAVEL, MEAN, OVERSHOOT, SETTLED)
WORST_COLUMNS = (OVERSHOOT, SETTLED)  # judged by the worst seed; the others by the mean over the seeds


@dataclass(frozen=True)
class Row:
    """A sea, its first result (rms, travel), and its targets.

    `bound`: the present result of a missed target, which must not become worse.
    """

    sea: str
    before: tuple[float, float] | None
    aim: dict[str, float] = field(default_factory=dict)
    bound: dict[str, float] = field(default_factory=dict)

    def limits(self):
        """Return the limits by column."""
        return {**self.aim, **self.bound}


ROWS = (
    Row("tank+float=0.3:0.6", (1.62, 3269.0), {RMS: 0.35, TRAVEL: 450.0}),
    Row("sea+float=0.3:0.6,receiver=0:1", (4.66, 5265.0), {RMS: 2.0, TRAVEL: 1500.0}),
    Row("sea+float=0.3:0.6", (1.30, 1067.0), {RMS: 1.3, TRAVEL: 1000.0, OVERSHOOT: 5.0}),
    Row("weak+float=0.3:0.6", (1.47, 1957.0), {RMS: 1.35, TRAVEL: 1300.0}, {RMS: 1.48}),
    Row("swell+leeway=8", (2.40, 1809.0), {RMS: 1.6, TRAVEL: 1200.0, MEAN: 0.3, OVERSHOOT: 4.0, SETTLED: 60.0}),
    Row("swell+orbital=0.4", (3.96, 2200.0), {RMS: 3.3, TRAVEL: 2500.0}),
    Row("swell+float=0.2:0.5,orbital=0.4,leeway=8", (5.74, 2861.0), {RMS: 3.9, TRAVEL: 2800.0}),
    # These seas must not become worse. The aims are from other seeds; `before` is from commit 97e86a0 with these seeds.
    Row("tank", (0.17, 155.0), {RMS: 0.21, TRAVEL: 143.0}, {TRAVEL: 150.0}),
    Row("sea", (1.17, 743.0), {RMS: 1.11, TRAVEL: 896.0}),
    Row("swell", (1.67, 672.0), {RMS: 1.46, TRAVEL: 1067.0}, {RMS: 1.6}),
    Row("weak", (1.38, 1160.0), {RMS: 1.25, TRAVEL: 1200.0}, {RMS: 1.4}),
    # Seas with several disturbances have no aim; the present results must not become worse.
    Row("ocean-1", (2.07, 1391.0), bound={RMS: 2.05, TRAVEL: 1350.0}),
    # Errors include the deviation of the uncorrected compass.
    Row("ocean-2", (5.85, 6374.0), bound={RMS: 4.9, TRAVEL: 1900.0}),
    Row("ocean-3", (1.47, 1551.0), bound={RMS: 1.85, TRAVEL: 1300.0}),
    Row("ocean-4", (7.61, 4930.0), bound={RMS: 6.3, TRAVEL: 3250.0}),
)
TASK = Task(tuple(row.sea for row in ROWS), SEEDS, parse_goals("0:0,120:60,720:-30"), 1320.0)


def simulate(sea, seeds):
    """Simulate runs in the compiled loop; yield the truth of each."""
    values = ParameterSet()
    boat, law, task = sailing.boat_of(values), LawSettings.of(values), sailing.task_of(TASK.goals)
    for seed in seeds:
        drawn_sea = draw_sea(parse_scenario(sea), seed, TASK.seconds)
        record, _ = sailing.sail(boat, law, drawn_sea, task, TASK.seconds, ticks=False)
        yield sailing.truth_of(record, TASK.goals)


def figures_of(truth):
    """Return the figures of a run by column; those of the turns are of the worst one."""
    score, turns = score_of(truth), turns_of(truth)
    overshoot_deg, settled_s = max(turn.overshoot_deg for turn in turns), max(turn.settled_s for turn in turns)
    values = (score.rms_deg, score.travel_deg_per_h, score.mean_deg, overshoot_deg, settled_s)
    return dict(zip(COLUMNS, values, strict=True))


def over_seeds(runs):
    """Return (mean, worst) by column; the rms is that over all runs."""
    result = {}
    for column in COLUMNS:
        values = [run[column] for run in runs]
        mean = math.sqrt(float(np.mean(np.square(values)))) if column == RMS else float(np.mean(values))
        result[column] = (mean, max(values, key=abs))
    return result


def distribution_of(sea):
    """Return rms and travel over many seeds with standard errors, and 10 and 90 % quantiles of the rms of five."""
    runs = [figures_of(truth) for truth in simulate(sea, range(1, MANY_SEEDS + 1))]
    square, travel = (np.array([run[column] for run in runs]) for column in (RMS, TRAVEL))
    square **= 2
    rms, rms_of_fives = math.sqrt(square.mean()), np.sqrt(square.reshape(-1, len(SEEDS)).mean(axis=1))
    standard_errors = [float(np.std(values, ddof=1)) / math.sqrt(MANY_SEEDS) for values in (square, travel)]
    return (
        rms,
        standard_errors[0] / (2.0 * rms),
        float(travel.mean()),
        standard_errors[1],
        np.quantile(rms_of_fives, (0.1, 0.9)).tolist(),
    )


def exceeded_columns(row, result):
    """Return the columns in which a row exceeds its limits."""
    return [
        column for column, limit in row.limits().items() if not abs(result[column][column in WORST_COLUMNS]) <= limit
    ]


@pytest.fixture(scope="module")
def table():
    """Print the simulated rows at the end."""
    lines = []
    yield lines
    print("\n".join(["", "mean / worst of the seeds; before; aim; bound where the aim is not reached", *lines]))


def test_all_seas_of_the_table_exist():
    assert [parse_scenario(row.sea).name for row in ROWS] == [row.sea.split("+")[0] for row in ROWS]
    assert len(ROWS) == len({row.sea for row in ROWS})


def test_row_is_missed_by_its_mean_or_its_worst_seed():
    row = Row("tank", None, {RMS: 1.0, OVERSHOOT: 4.0, MEAN: 0.3}, {RMS: 2.0})
    runs = [
        dict.fromkeys(COLUMNS, 0.0) | {RMS: rms, OVERSHOOT: overshoot} for rms, overshoot in ((1.9, 3.0), (2.05, 3.9))
    ]
    assert exceeded_columns(row, over_seeds(runs)) == []
    runs[0] |= {OVERSHOOT: 4.1, MEAN: -0.7}
    assert exceeded_columns(row, over_seeds(runs)) == [OVERSHOOT, MEAN]
    assert exceeded_columns(row, over_seeds([runs[0] | {RMS: math.nan, OVERSHOOT: math.inf, MEAN: 0.0}])) == [
        RMS,
        OVERSHOOT,
    ]


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("row", ROWS, ids=[row.sea for row in ROWS])
def test_targets_are_met(figures, table, row):
    result = over_seeds([figures_of(truth) for truth in simulate(row.sea, SEEDS)])
    text = "; ".join(f"{column} {mean:.2f} / {worst:.2f}" for column, (mean, worst) in result.items())
    rms, rms_error, travel, travel_error, rms_of_fives = distribution_of(row.sea)
    distribution_text = (
        f"{MANY_SEEDS} seeds: rms {rms:.3f} ± {rms_error:.3f}, of five {rms_of_fives[0]:.2f} to {rms_of_fives[1]:.2f};"
    )
    distribution_text += f" travel {travel:.0f} ± {travel_error:.0f}"
    table.append(
        f"{row.sea}: {text}\n    {row.before}; {json.dumps(row.aim)}; {json.dumps(row.bound)}\n    {distribution_text}"
    )
    print(f"\n{table[-1]}")
    figures.keep(key_of("ocean", row.sea, "rms"), result[RMS][0], "deg")
    figures.keep(key_of("ocean", row.sea, "travel"), result[TRAVEL][0], "deg/h")
    figures.keep(key_of("ocean", row.sea, "rms", "many"), rms, "deg")
    figures.keep(key_of("ocean", row.sea, "travel", "many"), travel, "deg/h")
    assert exceeded_columns(row, result) == []


@pytest.mark.proof
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("sea", CONFIRMED_SEAS)
def test_autopilot_gives_the_same_figures(sea):
    expected = figures_of(truth_of(TASK, sea, OURS, SEEDS[0]))
    assert figures_of(next(simulate(sea, SEEDS[:1]))) == pytest.approx(expected, rel=1e-6, abs=1e-6)
