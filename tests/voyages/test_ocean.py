"""The delivered autopilot in realistic seas: the task of capabilities.md, five seeds, one table of targets.

`pytest -m proof tests/voyages/test_ocean.py -s` sails it by the compiled twin and prints a table: mean / worst of the
seeds. The autopilot itself, on ptys, sails a few of the runs and is to come to the same figures.
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
from hil.lab.twin.sea import sea_of as drawn
from hil.report.figure_file import key_of
from hil.ship.scenarios import parse_scenario
from hil.sim.goals import parse_goals

SEEDS = (1, 2, 3, 4, 5)
MANY = 160  # seeds: what five of them are out of
CONFIRMED = ("swell", "weak+float=0.3:0.6", "ocean-4")  # with the first seed
RMS, TRAVEL, MEAN, OVERSHOOT, SETTLED = "rms deg", "travel deg/h", "mean deg", "overshoot deg", "settled s"
COLUMNS = (RMS, TRAVEL, MEAN, OVERSHOOT, SETTLED)
OF_THE_WORST = (OVERSHOOT, SETTLED)  # rms, travel and mean error are judged by the mean over the seeds


@dataclass(frozen=True)
class Row:
    """A sea; its first result (rms, travel); its target.

    `bound` is the present result where that misses the target: it must not get worse, and the table has both.
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
    Row(
        "swell+leeway=8",
        (2.40, 1809.0),
        {RMS: 1.6, TRAVEL: 1200.0, MEAN: 0.3, OVERSHOOT: 4.0, SETTLED: 60.0},
    ),
    Row("swell+orbital=0.4", (3.96, 2200.0), {RMS: 3.3, TRAVEL: 2500.0}),
    Row("swell+float=0.2:0.5,orbital=0.4,leeway=8", (5.74, 2861.0), {RMS: 3.9, TRAVEL: 2800.0}),
    # What was there is to stay as good. The aims are of others' seeds; `before` is what 97e86a0 made with these five.
    Row("tank", (0.17, 155.0), {RMS: 0.21, TRAVEL: 143.0}, {TRAVEL: 150.0}),
    Row("sea", (1.17, 743.0), {RMS: 1.11, TRAVEL: 896.0}),
    Row("swell", (1.67, 672.0), {RMS: 1.46, TRAVEL: 1067.0}, {RMS: 1.6}),
    Row("weak", (1.38, 1160.0), {RMS: 1.25, TRAVEL: 1200.0}, {RMS: 1.4}),
    # Several at a time: no aim was given, and what is reached is held.
    Row("ocean-1", (2.07, 1391.0), bound={RMS: 2.05, TRAVEL: 1350.0}),
    # An uncorrected compass is the reference all the same: its deviation is the boat's error.
    Row("ocean-2", (5.85, 6374.0), bound={RMS: 4.9, TRAVEL: 1900.0}),
    Row("ocean-3", (1.47, 1551.0), bound={RMS: 1.85, TRAVEL: 1300.0}),
    Row("ocean-4", (7.61, 4930.0), bound={RMS: 6.3, TRAVEL: 3250.0}),
)
TASK = Task(tuple(row.sea for row in ROWS), SEEDS, parse_goals("0:0,120:60,720:-30"), 1320.0)


def sailed(sea, seeds):
    """Sail runs in the compiled loop and return what truth.csv would hold of each."""
    values = ParameterSet()
    boat, law, task = sailing.boat_of(values), LawSettings.of(values), sailing.task_of(TASK.goals)
    for seed in seeds:
        waters = drawn(parse_scenario(sea), seed, TASK.seconds)
        record, _ = sailing.sail(boat, law, waters, task, TASK.seconds, ticks=False)
        yield sailing.truth_of(record, TASK.goals)


def figures_of(truth):
    """Return the figures of a run by column; the worst turn counts."""
    score, turns = score_of(truth), turns_of(truth)
    overshoot_deg, settled_s = max(turn.overshoot_deg for turn in turns), max(turn.settled_s for turn in turns)
    values = (score.rms_deg, score.travel_deg_per_h, score.mean_deg, overshoot_deg, settled_s)
    return dict(zip(COLUMNS, values, strict=True))


def over_seeds(runs):
    """Return (mean, worst) by column; the rms is that of all runs together."""
    found = {}
    for column in COLUMNS:
        values = [run[column] for run in runs]
        mean = math.sqrt(float(np.mean(np.square(values)))) if column == RMS else float(np.mean(values))
        found[column] = (mean, max(values, key=abs))
    return found


def of_many(sea):
    """Return the rms and travel of many seeds, with standard errors, and which rms nine of ten fives stay below."""
    runs = [figures_of(truth) for truth in sailed(sea, range(1, MANY + 1))]
    square, travel = (np.array([run[column] for run in runs]) for column in (RMS, TRAVEL))
    square **= 2
    rms, fives = math.sqrt(square.mean()), np.sqrt(square.reshape(-1, len(SEEDS)).mean(axis=1))
    errors = [float(np.std(values, ddof=1)) / math.sqrt(MANY) for values in (square, travel)]
    return rms, errors[0] / (2.0 * rms), float(travel.mean()), errors[1], np.quantile(fives, (0.1, 0.9)).tolist()


def missed(row, found):
    """Return the columns in which a row does not keep its limits."""
    return [column for column, limit in row.limits().items() if not abs(found[column][column in OF_THE_WORST]) <= limit]


@pytest.fixture(scope="module")
def table():
    """Print the rows that were sailed, in the end."""
    lines = []
    yield lines
    print("\n".join(["", "mean / worst of the seeds; before; aim; bound where the aim is not reached", *lines]))


def test_all_seas_of_the_table_exist():
    assert [parse_scenario(row.sea).name for row in ROWS] == [row.sea.split("+")[0] for row in ROWS]
    assert len(ROWS) == len({row.sea for row in ROWS})


def test_a_row_is_missed_by_its_mean_or_its_worst_seed():
    row = Row("tank", None, {RMS: 1.0, OVERSHOOT: 4.0, MEAN: 0.3}, {RMS: 2.0})
    runs = [dict.fromkeys(COLUMNS, 0.0) | {RMS: rms, OVERSHOOT: over} for rms, over in ((1.9, 3.0), (2.05, 3.9))]
    assert missed(row, over_seeds(runs)) == []
    runs[0] |= {OVERSHOOT: 4.1, MEAN: -0.7}
    assert missed(row, over_seeds(runs)) == [OVERSHOOT, MEAN]
    assert missed(row, over_seeds([runs[0] | {RMS: math.nan, OVERSHOOT: math.inf, MEAN: 0.0}])) == [RMS, OVERSHOOT]


@pytest.mark.proof
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("row", ROWS, ids=[row.sea for row in ROWS])
def test_targets_are_met(figures, table, row):
    found = over_seeds([figures_of(truth) for truth in sailed(row.sea, SEEDS)])
    text = "; ".join(f"{column} {mean:.2f} / {worst:.2f}" for column, (mean, worst) in found.items())
    rms, rms_error, travel, travel_error, fives = of_many(row.sea)
    many = f"{MANY} seeds: rms {rms:.3f} ± {rms_error:.3f}, of five {fives[0]:.2f} to {fives[1]:.2f};"
    many += f" travel {travel:.0f} ± {travel_error:.0f}"
    table.append(f"{row.sea}: {text}\n    {row.before}; {json.dumps(row.aim)}; {json.dumps(row.bound)}\n    {many}")
    print(f"\n{table[-1]}")
    figures.keep(key_of("ocean", row.sea, "rms"), found[RMS][0], "deg")
    figures.keep(key_of("ocean", row.sea, "travel"), found[TRAVEL][0], "deg/h")
    figures.keep(key_of("ocean", row.sea, "rms", "many"), rms, "deg")
    figures.keep(key_of("ocean", row.sea, "travel", "many"), travel, "deg/h")
    assert missed(row, found) == []


@pytest.mark.proof
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("sea", CONFIRMED)
def test_the_autopilot_makes_the_same_figures(sea):
    theirs = figures_of(truth_of(TASK, sea, OURS, SEEDS[0]))
    assert figures_of(next(sailed(sea, SEEDS[:1]))) == pytest.approx(theirs, rel=1e-6, abs=1e-6)
