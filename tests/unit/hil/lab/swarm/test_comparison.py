"""Comparison of searches: budgets, errors, winner and command line."""

import importlib.util
import json

import numpy as np
import pytest

from hil.__main__ import main
from hil.lab.swarm.comparison import SEARCHES, TABLE, Budget, Row, _SpentError, compare, smallest_error, sphere, text

needs_cma = pytest.mark.skipif(importlib.util.find_spec("cma") is None, reason="cma is in the extra dev")
LOW, HIGH = np.full(2, -5.12), np.full(2, 5.12)


def test_evaluations_beyond_the_budget_are_ignored():
    budget = Budget(lambda points: points[:, 0], 3)
    budget(np.array([[5.0], [4.0]]))
    with pytest.raises(_SpentError):
        budget(np.array([[3.0], [-9.0]]))
    assert budget.minimum == 3.0
    with pytest.raises(_SpentError):
        budget(np.array([[-9.0]]))
    assert budget.minimum == 3.0


@needs_cma
@pytest.mark.parametrize("name", SEARCHES)
def test_search_uses_its_budget_and_depends_only_on_its_seed(name):
    sizes = []

    def counting_sphere(points):
        sizes.append(len(points))
        return sphere(points)

    first = smallest_error(SEARCHES[name], counting_sphere, LOW, HIGH, 1500, 3)
    assert 1200 <= sum(sizes) <= 1700
    assert first == smallest_error(SEARCHES[name], sphere, LOW, HIGH, 1500, 3)
    assert first < (0.1 if name == "chance" else 0.01)


@needs_cma
def test_row_has_an_error_for_each_search_and_seed():
    (row,) = compare(TABLE[:1], 2, 800, (1, 2))
    assert (row.function, row.dimensions, row.evaluations) == ("sphere", 2, 800)
    assert {name: len(errors) for name, errors in row.errors.items()} == dict.fromkeys(SEARCHES, 2)


def test_winner_has_the_most_solved_runs():
    bad_errors = (1.0, 1.0, 1.0)
    errors = {"fish": (1e-3, 1e-9, 1.0), "DE": (1e-7, 1e-9, 1.0), "CMA-ES": bad_errors, "chance": bad_errors}
    row = Row("sphere", 2, 100, errors)
    assert row.winner() == "DE"
    assert (row.median("fish"), row.solved("DE")) == (1e-3, 2)
    table = text([row], 3)
    assert "1.0e-03 (1/3)" in table
    assert table.splitlines()[-1].endswith("best of 1: fish 0, DE 1, CMA-ES 0, chance 0")


@needs_cma
def test_command_prints_the_table(capsys):
    assert main(["swarm-table", "--dimensions", "2", "--evaluations", "200", "--runs", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:7]] == [row.name for row in TABLE]
    assert main(["swarm-table", "--dimensions", "2", "--evaluations", "200", "--runs", "1", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)) == 6


@pytest.mark.parametrize(
    "arguments", [["--runs", "0"], ["--evaluations", "1"], ["--dimensions", "1"], ["--dimensions", "2,x"]]
)
def test_invalid_numbers_are_refused(capsys, arguments):
    assert main(["swarm-table", *arguments]) == 2
    assert "give " in capsys.readouterr().err
