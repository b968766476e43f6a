"""Equations 1 to 3 of the paper with their coefficients."""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_py.model.kt import KtModel
from hil.ship.manoeuvring import sway_ratios
from hil.ship.regressions import (
    HullForm,
    surge_added_mass_ratio,
    sway_acceleration_derivative,
    sway_model,
    sway_velocity_derivative,
)


@dataclass(frozen=True, slots=True)
class Equation:
    """An equation with symbols, with numbers in SI units, and these numbers by name."""

    number: int
    name: str
    symbols: tuple[str, ...]
    numbers: tuple[str, ...]
    coefficients: dict[str, float]

    @property
    def title(self) -> str:
        """Return number and name."""
        return f"({self.number}) {self.name}"

    @property
    def lines(self) -> tuple[str, ...]:
        """Return the lines with symbols, then those with numbers."""
        return self.symbols + tuple(f"    {line}" for line in self.numbers)


def equations(hull: HullForm, model: KtModel) -> tuple[Equation, ...]:
    """Return the equations for a hull and its model, at the speed of the model."""
    return _kinematics(model), _dynamics(hull, model), _regressions(hull, model)


def _kinematics(model: KtModel) -> Equation:
    speed = f"{model.speed_m_s:.4g}"
    return Equation(
        1,
        "track and heading",
        ("dx/dt = U cos psi - v sin psi", "dy/dt = U sin psi + v cos psi", "dpsi/dt = r"),
        (f"dx/dt = {speed} cos psi - v sin psi", f"dy/dt = {speed} sin psi + v cos psi", "dpsi/dt = r"),
        {"U_m_s": model.speed_m_s},
    )


def _dynamics(hull: HullForm, model: KtModel) -> Equation:
    sway, speed_m_s = sway_model(hull), model.speed_m_s
    damping_kg_s = sway.sway_damping_kg_s(speed_m_s)
    drive_m_s, damping_1_s = sway_ratios(sway, speed_m_s)
    ability_1_s, lag_s, norrbin_s2 = model[:3]
    return Equation(
        2,
        "sway and yaw",
        ("m22 dv/dt = -m11 U r + Yv v", "T dr/dt + r + alpha r^3 = K (delta - delta0)"),
        (
            f"{sway.sway_mass_kg:.4g} dv/dt = -{sway.surge_mass_kg:.4g} x {speed_m_s:.4g} r - {-damping_kg_s:.4g} v",
            f"dv/dt = -{-drive_m_s:.4g} r - {-damping_1_s:.4g} v",
            f"{lag_s:.4g} dr/dt + r + {norrbin_s2:.4g} r^3 = {ability_1_s:.4g} (delta - delta0)",
        ),
        {
            "m11_kg": sway.surge_mass_kg,
            "m22_kg": sway.sway_mass_kg,
            "Yv_kg_s": damping_kg_s,
            "K_1_s": ability_1_s,
            "T_s": lag_s,
            "alpha_s2": norrbin_s2,
        },
    )


def _regressions(hull: HullForm, model: KtModel) -> Equation:
    sway = sway_model(hull)
    block, slender = hull.block_coefficient, hull.length_m / hull.beam_m
    flat, wide = hull.draft_m / hull.beam_m, hull.beam_m / hull.draft_m
    deep, broad = hull.draft_m / hull.length_m, hull.beam_m / hull.length_m
    surge_ratio = surge_added_mass_ratio(hull)
    acceleration, velocity = sway_acceleration_derivative(hull), sway_velocity_derivative(hull)
    damping_kg_s = sway.sway_damping_kg_s(model.speed_m_s)
    added_sway_kg = sway.sway_mass_kg - hull.mass_kg
    return Equation(
        3,
        "added masses and sway damping (Zhou; Clarke et al. 1982)",
        (
            (
                "m11 = m (1 + mx/m), 100 mx/m = 0.398 + 11.97 Cb (1 + 3.73 D/B) - 2.89 Cb L/B (1 + 1.13 D/B) "
                "+ 0.175 Cb (L/B)^2 (1 + 0.541 D/B) - 1.107 L/B D/B"
            ),
            "m22 = m - (rho/2) L^3 Y'vdot, Y'vdot = -pi (D/L)^2 (1 + 0.16 Cb B/D - 5.1 (B/L)^2)",
            "Yv = (rho/2) L^2 U Y'v, Y'v = -pi (D/L)^2 (1 + 0.40 Cb B/D)",
        ),
        (
            (
                f"100 mx/m = 0.398 + {11.97 * block * (1.0 + 3.73 * flat):.4g} "
                f"- {2.89 * block * slender * (1.0 + 1.13 * flat):.4g} "
                f"+ {0.175 * block * slender**2 * (1.0 + 0.541 * flat):.4g} - {1.107 * slender * flat:.4g} "
                f"= {100.0 * surge_ratio:.4g}; m11 = {sway.surge_mass_kg:.4g} kg"
            ),
            (
                f"Y'vdot = -{math.pi * deep**2:.4g} (1 + {0.16 * block * wide:.4g} - {5.1 * broad**2:.4g}) "
                f"= {acceleration:.4g}; m22 = {hull.mass_kg:g} + {added_sway_kg:.4g} = {sway.sway_mass_kg:.4g} kg"
            ),
            (
                f"Y'v = -{math.pi * deep**2:.4g} (1 + {0.40 * block * wide:.4g}) = {velocity:.4g}; "
                f"Yv = {sway.sway_damping_kg_m:.4g} U = {damping_kg_s:.4g} kg/s"
            ),
        ),
        {
            "L_m": hull.length_m,
            "B_m": hull.beam_m,
            "D_m": hull.draft_m,
            "m_kg": hull.mass_kg,
            "Cb": block,
            "mx_over_m": surge_ratio,
            "Yvdot_dimensionless": acceleration,
            "Yv_dimensionless": velocity,
        },
    )
