"""Figures and targets of measured quantities."""

import math
from dataclasses import replace

import pytest

from hil.bench import process, tools
from hil.bench.machine import Memory
from hil.bench.setting import quick


def test_load_has_figures_with_targets():
    figures = process.load_figures((0.014, 0.021), Memory(61.0, 62.0), 0.0005, Memory(8.0, 9.0))
    assert [(figure.name, figure.value, figure.bare) for figure in figures[:2]] == [
        ("CPU at 10 Hz", pytest.approx(2.1), pytest.approx(0.05)),
        ("CPU at 10 Hz, one link", pytest.approx(1.4), pytest.approx(0.05)),
    ]
    assert [figure.met for figure in figures] == [False, True, False, None]


def test_lockstep_figures_are_medians():
    figures = process.lockstep_figures([100.0, 160.0, 170.0], [99.0, 40.0, 300.0])
    assert [(figure.value, figure.met) for figure in figures] == [(160.0, True), (99.0, False)]


def test_start_figures_are_medians():
    frame, heartbeat = process.start_figures([0.4, 3.0, 0.5], [0.4, 0.3, 9.0], [0.02, 0.01, 0.03])
    assert (frame.value, frame.bare, frame.met) == (0.5, 0.02, True)
    assert (heartbeat.value, heartbeat.met) == (0.4, None)


def test_loop_figures_are_the_median_and_its_inverse():
    tick, rate = tools.loop_figures([2000.0, 4000.0, 9000.0])
    assert (tick.value, rate.value, rate.met) == (4000.0, 2.5e5, True)


def test_identification_figures_are_medians():
    wall, cpu = tools.hour_figures([1.9, 9.0, 1.8], [1.5, 1.6, 1.7])
    assert (wall.value, wall.met) == (1.9, True)
    assert (cpu.value, cpu.met) == (1.6, None)


@pytest.mark.proof
def test_swarm_costs_more_than_its_objective(tmp_path):
    (figure,) = tools.swarm(replace(quick(tmp_path), pairs=1, evaluations=1000)).figures
    assert 0.0 < figure.bare < figure.value < math.inf
