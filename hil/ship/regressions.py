"""Added masses and sway damping of a hull from its main particulars (Wang et al. 2018, eq. 3).

Sources: Zhou Zhaoming et al. (1983), a regression of Motora's charts, for surge; Clarke, Gedling and Hine, Trans. RINA
125 (1982), regressions over captive tests of ship models, for sway. Both are for merchant ships. ENVELOPE is the range
of such hulls; the formulas are published without limits, so outside it the results are extrapolated, with a warning.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

SEA_WATER_KG_M3 = 1025.0

# quantity -> (minimum, maximum) of merchant hulls
ENVELOPE = {"length / beam": (4.0, 10.0), "beam / draft": (2.0, 4.5), "block coefficient": (0.5, 0.85)}


@dataclass(frozen=True, slots=True)
class HullForm:
    """Main particulars of the float; the mass includes all that moves with it (in the paper glider and umbilical).

    Raises ValueError for a number that is not positive and finite, or a block coefficient above 1.
    """

    length_m: float
    beam_m: float
    draft_m: float
    mass_kg: float
    block_coefficient: float

    def __post_init__(self) -> None:
        """Check the particulars."""
        for name in ("length_m", "beam_m", "draft_m", "mass_kg", "block_coefficient"):
            value = getattr(self, name)
            if not (math.isfinite(value) and 0.0 < value < 1e6):
                raise ValueError(f"hull: {name} {value:g} must be positive")
        if self.block_coefficient > 1.0:
            raise ValueError(
                f"hull: a block coefficient of {self.block_coefficient:.3g} is more than a box of "
                f"{self.length_m:g} x {self.beam_m:g} x {self.draft_m:g} m displaces; check the mass and the draft"
            )

    @classmethod
    def from_mass(cls, length_m: float, beam_m: float, draft_m: float, mass_kg: float) -> HullForm:
        """Compute the block coefficient from the mass, which the float displaces at this draft."""
        box_kg = SEA_WATER_KG_M3 * length_m * beam_m * draft_m
        return cls(length_m, beam_m, draft_m, mass_kg, mass_kg / box_kg if box_kg > 0.0 else math.nan)


# A published float of the same class, with the 200 kg that it and its glider weigh.
FLOAT = HullForm.from_mass(3.05, 0.81, 0.23, 200.0)


@dataclass(frozen=True, slots=True)
class SwayModel:
    """m11 and m22 [kg], Yv [kg/s] per speed through the water [kg/m], and warnings."""

    surge_mass_kg: float
    sway_mass_kg: float
    sway_damping_kg_m: float
    warnings: tuple[str, ...]

    def sway_damping_kg_s(self, speed_m_s: float) -> float:
        """Return Yv at a speed: the force per sway velocity, negative."""
        return self.sway_damping_kg_m * speed_m_s


def sway_model(hull: HullForm, density_kg_m3: float = SEA_WATER_KG_M3) -> SwayModel:
    """Estimate a hull's masses and damping, with a warning for each quantity outside the regressions."""
    added_surge_kg = surge_added_mass_ratio(hull) * hull.mass_kg
    added_sway_kg = -0.5 * density_kg_m3 * hull.length_m**3 * sway_acceleration_derivative(hull)
    damping_kg_m = 0.5 * density_kg_m3 * hull.length_m**2 * sway_velocity_derivative(hull)
    warnings = list(envelope_warnings(hull))
    if added_surge_kg < 0.0:
        warnings.append(f"Zhou gives a negative surge added mass, {added_surge_kg:.3g} kg; taken as 0")
        added_surge_kg = 0.0
    if added_sway_kg < 0.0:
        warnings.append(f"Clarke gives a negative sway added mass, {added_sway_kg:.3g} kg; taken as 0")
        added_sway_kg = 0.0
    return SwayModel(hull.mass_kg + added_surge_kg, hull.mass_kg + added_sway_kg, damping_kg_m, tuple(warnings))


def surge_added_mass_ratio(hull: HullForm) -> float:
    """Return m_x / m (Zhou); the derivative Xudot is -m_x."""
    block, slender, flat = hull.block_coefficient, hull.length_m / hull.beam_m, hull.draft_m / hull.beam_m
    percent = (
        0.398
        + 11.97 * block * (1.0 + 3.73 * flat)
        - 2.89 * block * slender * (1.0 + 1.13 * flat)
        + 0.175 * block * slender**2 * (1.0 + 0.541 * flat)
        - 1.107 * slender * flat
    )
    return 0.01 * percent


def sway_acceleration_derivative(hull: HullForm) -> float:
    """Return Yvdot' (Clarke), made dimensionless by rho L^3 / 2; negative."""
    block_term = 0.16 * hull.block_coefficient * hull.beam_m / hull.draft_m
    beam_term = 5.1 * (hull.beam_m / hull.length_m) ** 2
    return -math.pi * (hull.draft_m / hull.length_m) ** 2 * (1.0 + block_term - beam_term)


def sway_velocity_derivative(hull: HullForm) -> float:
    """Return Yv' (Clarke), made dimensionless by rho L^2 U / 2; negative."""
    block_term = 0.40 * hull.block_coefficient * hull.beam_m / hull.draft_m
    return -math.pi * (hull.draft_m / hull.length_m) ** 2 * (1.0 + block_term)


def envelope_warnings(hull: HullForm) -> tuple[str, ...]:
    """Return a warning for each quantity outside the envelope of merchant ships."""
    quantities = {
        "length / beam": hull.length_m / hull.beam_m,
        "beam / draft": hull.beam_m / hull.draft_m,
        "block coefficient": hull.block_coefficient,
    }
    return tuple(
        f"{name} {value:.3g} is outside {ENVELOPE[name][0]:g} to {ENVELOPE[name][1]:g}, the range of the ships "
        f"behind the Zhou and Clarke regressions: sway is extrapolated"
        for name, value in quantities.items()
        if not ENVELOPE[name][0] <= value <= ENVELOPE[name][1]
    )
