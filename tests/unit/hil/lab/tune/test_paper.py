"""The tuning problem of the paper: the figures that docs/explanation/physics.md states."""

import numpy as np
import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.lab.tune import paper
from hil.lab.tune.cases import autopilot_of

AUTOPILOT = autopilot_of(ParameterSet())


@pytest.fixture(scope="module")
def studies() -> dict[float, paper.StepStudy]:
    return {step_deg: paper.study(step_deg, OCEAN_RAMBLER, AUTOPILOT, 1) for step_deg in paper.STEPS_DEG}


@pytest.mark.parametrize(("step_deg", "excess", "overshoot"), [(30.0, 0.08, 0.016), (90.0, 0.02, 0.006)])
def test_itae_of_the_papers_gains_is_near_the_minimum(studies, step_deg, excess, overshoot):
    study = studies[step_deg]
    assert 0.0 < study.excess <= excess
    assert study.paper_overshoot == pytest.approx(overshoot, abs=0.001)


def test_minimum_of_itae_is_at_the_limit_of_k1(studies):
    for study in studies.values():
        assert study.swarm.best[0] == pytest.approx(60.0, abs=0.1)
        assert 0.5 < study.swarm.best[1] < 1.2


def test_swarm_finds_the_minimum_of_the_map(studies):
    for study in studies.values():
        assert study.swarm.best_value <= np.min(study.itae_map) * 1.0001
        row, column = np.unravel_index(np.argmin(study.itae_map), study.itae_map.shape)
        assert study.k1[column] == pytest.approx(study.swarm.best[0], abs=1.1)
        assert study.k2[row] == pytest.approx(study.swarm.best[1], abs=0.3)


def test_same_seed_gives_the_same_result(studies):
    again = paper.study(30.0, OCEAN_RAMBLER, AUTOPILOT, 1)
    assert np.array_equal(again.swarm.best, studies[30.0].swarm.best)
    assert np.array_equal(again.itae_map, studies[30.0].itae_map)


def test_response_of_a_slow_ship_is_long_enough():
    slow = type(OCEAN_RAMBLER)(0.002, 200.0, 0.0, 0.0, 5.0)
    parameters = ParameterSet().replaced("MDL_K", 0.002).replaced("MDL_T_S", 200.0).replaced("MDL_ALPHA_S2", 0.0)
    study = paper.study(30.0, slow, autopilot_of(parameters), 1)
    assert np.all(np.isfinite(study.itae_map))
    assert study.excess >= 0.0
