"""The tuning problem of the paper: smallest ITAE of a step in the K-T model without noise, over k1 and k2.

Source: Wang et al. 2018, section 3 and eq. 8: J = integral of t |e| dt; the artificial fish swarm finds k1 = 40 and
k2 = 0.3. The paper does not state its step or its box. This module uses steps of 30 and 90 deg, 1 <= k1 <= 60,
0 <= k2 <= 10 and an instant rudder.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_py.common.angles import DEGREES_PER_RADIAN, radians
from firmware_py.model.kt import KtModel, rk4_step
from hil.lab.compiled import compiled, compiling
from hil.lab.numeric_core import law
from hil.lab.swarm import SwarmResult, SwarmSettings, minimise
from hil.lab.tune.cases import steps_in
from hil.lab.tune.loop_kernel import Autopilot, Floats

PAPER_K1, PAPER_K2 = 40.0, 0.3
BOX_LOW, BOX_HIGH = (1.0, 0.0), (60.0, 10.0)
STEPS_DEG = (30.0, 90.0)
TICKS_PER_RESPONSE = 2000  # about 200 s for the boat of the paper
COLUMNS, ROWS = 60, 51  # of the map over k1 and k2
FISH_COUNT, ITERATIONS, TRIES = 16, 30, 3


@compiled
def step_response(
    k1: float, k2: float, step_rad: float, step_s: float, autopilot: Autopilot, ship: Floats
) -> tuple[float, float]:
    """Return ITAE [rad s^2] and overshoot [rad] of a step with perfect sensors and an instant rudder."""
    psi = r = itae = overshoot = 0.0
    inner_steps = int(ship[3])
    gains = law.Gains(k1, k2, autopilot.rudder_limit_rad, autopilot.rate_max_rad_s, autopilot.trim_rad)
    for tick in range(TICKS_PER_RESPONSE):
        rudder = law.s_surface(gains, step_rad - psi, r)
        previous_error_rad = abs(step_rad - psi)
        for _ in range(inner_steps):
            psi, r = rk4_step(psi, r, rudder, step_s / inner_steps, ship[0], ship[1], ship[2], 0.0)
        itae += 0.5 * step_s * step_s * (tick * previous_error_rad + (tick + 1) * abs(step_rad - psi))
        overshoot = max(overshoot, psi - step_rad)
    return itae, overshoot


@compiled
def fill_itae(
    points: Floats, values: Floats, step_rad: float, step_s: float, autopilot: Autopilot, ship: Floats
) -> None:
    """Write the ITAE [rad s^2] of every point (k1, k2) into `values`."""
    for number in range(points.shape[0]):
        values[number] = step_response(points[number, 0], points[number, 1], step_rad, step_s, autopilot, ship)[0]


@dataclass(frozen=True, slots=True)
class StepStudy:
    """Results for one step: ITAE [deg s^2] over (k2, k1), optimum of the swarm, and results of the paper's gains."""

    step_deg: float
    k1: Floats
    k2: Floats
    itae_map: Floats
    swarm: SwarmResult
    paper_itae: float
    paper_overshoot: float  # relative to the step
    best_overshoot: float

    @property
    def best_itae(self) -> float:
        """Return the smaller of the smallest ITAE of the swarm and of the map."""
        return min(self.swarm.best_value, float(np.min(self.itae_map)))

    @property
    def excess(self) -> float:
        """Return the relative excess of the paper's gains over the smallest ITAE."""
        return self.paper_itae / self.best_itae - 1.0


def study(step_deg: float, model: KtModel, autopilot: Autopilot, seed: int) -> StepStudy:
    """Compute the map of a step and search it with the fish swarm; raise ValueError for an invalid model."""
    step_rad = radians(step_deg)
    # The response is long enough for the slowest reasonable turn.
    step_s = 2.5 * (step_rad / autopilot.rate_max_rad_s + 5.0 * model.turning_lag_s) / TICKS_PER_RESPONSE
    ship = np.array([model.turning_ability_1_s, model.turning_lag_s, model.norrbin_s2, steps_in(model, step_s)])

    def itae_deg(points: Floats) -> Floats:
        values = np.zeros(len(points))
        fill_itae(points, values, step_rad, step_s, autopilot, ship)
        return values * DEGREES_PER_RADIAN

    k1, k2 = np.linspace(BOX_LOW[0], BOX_HIGH[0], COLUMNS), np.linspace(BOX_LOW[1], BOX_HIGH[1], ROWS)
    points = np.stack([grid.ravel() for grid in np.meshgrid(k1, k2)], axis=1)
    with compiling("the step response"):
        itae_map = itae_deg(points).reshape(ROWS, COLUMNS)
    optimum = minimise(
        itae_deg, BOX_LOW, BOX_HIGH, SwarmSettings(fish=FISH_COUNT, iterations=ITERATIONS, tries=TRIES, seed=seed)
    )
    paper_itae, paper_overshoot = step_response(PAPER_K1, PAPER_K2, step_rad, step_s, autopilot, ship)
    _, best_overshoot = step_response(float(optimum.best[0]), float(optimum.best[1]), step_rad, step_s, autopilot, ship)
    return StepStudy(
        step_deg=step_deg,
        k1=k1,
        k2=k2,
        itae_map=itae_map,
        swarm=optimum,
        paper_itae=paper_itae * DEGREES_PER_RADIAN,
        paper_overshoot=paper_overshoot / step_rad,
        best_overshoot=best_overshoot / step_rad,
    )
