"""Panels, battery and loads of a boat: the true values of what a charger and a battery monitor measure.

The sun's elevation follows from time and place; the panels lie flat. The irradiance of a clear sky is Haurwitz's
(Journal of Meteorology 2, 1945: 1098 sin h exp(-0.057 / sin h) W/m2). Clouds have exponential lengths and transmit a
share that is drawn for each. The battery receives the power that the loads do not use, until it is full. The
model of the battery is an open-circuit voltage, a function of its charge, and a series resistance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hil.ship.disturbances import Supply

STEP_S = 1.0
CHARGER_EFFICIENCY = 0.97  # of a charger; data sheets state 0.96 to 0.98
RESISTANCE_OHM = 0.03
MEAN_CLOUD_S = 600.0  # mean length of a cloud
SKY_TIME_CONSTANT_S = 10.0  # time constant of the change between cloud and clear sky
CLOUD_TRANSMISSION = (0.1, 0.6)  # range of the share of the irradiance that a cloud transmits
DAY_S = 86_400.0
_YEAR_S = 365.2422 * DAY_S
_TILT_RAD = math.radians(23.44)
_SOLSTICE_S = 10.0 * DAY_S  # before the year's end
# Four cells of lithium iron phosphate: open-circuit voltage by state of charge.
_CHARGES = (0.0, 0.05, 0.1, 0.2, 0.4, 0.7, 0.9, 0.99, 1.0)
_OPEN_CIRCUIT_V = (10.0, 12.0, 12.8, 12.9, 13.1, 13.2, 13.3, 13.5, 13.8)
_NOMINAL_V = 12.8


@dataclass(frozen=True, slots=True)
class Place:
    """Position of the panels, and UTC at time 0."""

    latitude_deg: float
    longitude_deg: float
    begin_utc_s: float


@dataclass(frozen=True, slots=True)
class Totals:
    """Energy and charge since the start, in joules and coulombs.

    `charger_j` is the output of the charger, `battery_c` the net charge into the battery, `empty_s` the time during
    which an empty battery could not supply the loads.
    """

    panel_j: float = 0.0
    charger_j: float = 0.0
    load_j: float = 0.0
    servo_j: float = 0.0
    into_battery_j: float = 0.0
    out_of_battery_j: float = 0.0
    battery_c: float = 0.0
    load_c: float = 0.0
    empty_s: float = 0.0


class PowerPlant:
    """Power model in steps of one second; `servo_j` returns the energy that the servo has used so far."""

    def __init__(self, supply: Supply, place: Place, rng: np.random.Generator, servo_j: Callable[[], float]) -> None:
        """Start at time 0 with a clear sky."""
        self._supply, self._place, self._rng, self._servo_j = supply, place, rng, servo_j
        self._step = 0
        self._previous_servo_j = servo_j()
        self._is_cloudy, self._target_transmission, self._sky_transmission = False, 1.0, 1.0
        self._sky_change_s = self._draw_duration_s()
        self.charge = supply.charge
        self.voltage_v = float(np.interp(self.charge, _CHARGES, _OPEN_CIRCUIT_V))
        self.panel_v = 0.0
        self.totals = Totals()

    def advance_to(self, now_s: float) -> None:
        """Advance to the last whole second at or before now_s."""
        while (self._step + 1) * STEP_S <= now_s:
            self._step += 1
            self._advance(self._step * STEP_S)

    def elevation_rad(self, t_s: float) -> float:
        """Return the elevation of the sun, in mean solar time."""
        utc_s = self._place.begin_utc_s + t_s
        year = (utc_s + _SOLSTICE_S) % _YEAR_S / _YEAR_S
        declination_rad = -_TILT_RAD * math.cos(math.tau * year)
        hour_rad = math.tau * ((utc_s % DAY_S) / DAY_S - 0.5) + math.radians(self._place.longitude_deg)
        latitude_rad = math.radians(self._place.latitude_deg)
        return math.asin(
            math.sin(latitude_rad) * math.sin(declination_rad)
            + math.cos(latitude_rad) * math.cos(declination_rad) * math.cos(hour_rad)
        )

    def _advance(self, t_s: float) -> None:
        self._change_sky(t_s)
        sine = math.sin(self.elevation_rad(t_s))
        clear_w_m2 = 1098.0 * sine * math.exp(-0.057 / sine) if sine > 1e-3 else 0.0
        available_w = CHARGER_EFFICIENCY * self._supply.panel_w * self._sky_transmission * clear_w_m2 / 1000.0
        servo_j = self._servo_j()
        servo_w = (servo_j - self._previous_servo_j) / STEP_S
        self._previous_servo_j = servo_j
        load_w = self._supply.load_w + servo_w
        is_full, is_empty = self.charge >= 1.0, self.charge <= 0.0
        charger_w = min(available_w, load_w) if is_full else available_w
        net_w = charger_w - load_w
        open_circuit_v = float(np.interp(self.charge, _CHARGES, _OPEN_CIRCUIT_V))
        # V = E + R I and I = P / V.
        square_v2 = open_circuit_v * open_circuit_v + 4.0 * RESISTANCE_OHM * net_w
        self.voltage_v = 0.5 * (open_circuit_v + math.sqrt(max(0.0, square_v2)))
        # Assumed, near the maximum power point of panels of 36 cells.
        self.panel_v = 0.0 if sine <= 0.0 else 18.0 + 2.0 * self._sky_transmission
        current_a = net_w / self.voltage_v
        capacity_c = self._supply.battery_wh / _NOMINAL_V * 3600.0
        self.charge = min(1.0, max(0.0, self.charge + current_a * STEP_S / capacity_c))
        previous = self.totals
        self.totals = replace(
            previous,
            panel_j=previous.panel_j + charger_w / CHARGER_EFFICIENCY * STEP_S,
            charger_j=previous.charger_j + charger_w * STEP_S,
            load_j=previous.load_j + load_w * STEP_S,
            servo_j=servo_j,
            into_battery_j=previous.into_battery_j + max(0.0, net_w) * STEP_S,
            out_of_battery_j=previous.out_of_battery_j + max(0.0, -net_w) * STEP_S,
            battery_c=previous.battery_c + current_a * STEP_S,
            load_c=previous.load_c + load_w / self.voltage_v * STEP_S,
            empty_s=previous.empty_s + (STEP_S if is_empty and net_w < 0.0 else 0.0),
        )

    def _change_sky(self, t_s: float) -> None:
        while t_s >= self._sky_change_s:
            self._is_cloudy = not self._is_cloudy
            self._target_transmission = float(self._rng.uniform(*CLOUD_TRANSMISSION)) if self._is_cloudy else 1.0
            self._sky_change_s += self._draw_duration_s()
        weight = -math.expm1(-STEP_S / SKY_TIME_CONSTANT_S)
        self._sky_transmission += (self._target_transmission - self._sky_transmission) * weight

    def _draw_duration_s(self) -> float:
        """Draw the duration of the present sky, cloudy or clear."""
        share = self._supply.clouds
        if share <= 0.0:
            return math.inf
        mean_s = MEAN_CLOUD_S if self._is_cloudy else MEAN_CLOUD_S * (1.0 - share) / share
        return float(self._rng.exponential(mean_s)) + STEP_S


def energy_figures(plant: PowerPlant) -> dict[str, float]:
    """Return for the figures of a run the energies so far, the state of charge (0 to 1) and the time without power."""
    totals = plant.totals
    return {
        "panel_wh": totals.panel_j / 3600.0,
        "charger_wh": totals.charger_j / 3600.0,
        "load_wh": totals.load_j / 3600.0,
        "servo_wh": totals.servo_j / 3600.0,
        "into_battery_wh": totals.into_battery_j / 3600.0,
        "out_of_battery_wh": totals.out_of_battery_j / 3600.0,
        "charge": plant.charge,
        "empty_h": totals.empty_s / 3600.0,
    }
