"""Properties of the simulated seas, in quantities that were measured on a vessel (docs/explanation/physics.md).

A proportional controller steers north by the hull's heading without wave yaw, so that no estimator has an effect.
"""

import math
from functools import cache

import numpy as np
import pytest

from firmware_py.common.angles import radians
from hil.lab.compiled import compiled_here
from hil.lab.twin import sailing
from hil.lab.twin import ship as ships
from hil.lab.twin.sea import DEFAULT_RECEIVER, offset_of
from hil.lab.twin.sea import sea_of as draw_sea
from hil.ship.scenarios import TABLE, parse_scenario
from support.paths import ROOT

pytestmark = [pytest.mark.proof, pytest.mark.timeout(1800)]

GAIN, LIMIT_RAD = 1.15, radians(30.0)
STEPS_PER_ROW = 5
ROW_S = STEPS_PER_ROW * ships.GRID_S
SECONDS, BIAS_SECONDS = 6 * 3600.0, 48 * 3600.0  # longer for the bias, which changes slowly
RECORDED_LIKE = ("fjord", "coast", "offshore")
OTHER_SEAS = tuple(row.name for row in TABLE if row.name not in RECORDED_LIKE)
# Minimum and maximum of 21 runs of a vessel of 5 m, 186 h in total, in the order of the page.
RECORDED = {
    "rate_spectrum": (1.1, 28.0),
    "diffusion": (0.4, 10.0),
    "wave_yaw": (0.3, 2.6),
    "wave_period": (1.9, 3.6),
    "wave_damping": (0.09, 0.59),
    "orbit": (0.02, 0.47),
    "orbit_period": (5.5, 8.5),
    "receiver_filter": (4.0, 20.0),
    "receiver_noise": (0.005, 0.005),
    "bias": (8.0, 15.0),
    "bias_memory": (900.0, 3500.0),
    "speed_sd": (0.04, 0.21),
    "speed_memory": (30.0, 30.0),
    "course": (-44.0, 38.0),
}
RELATIVE_TOLERANCE = 0.15  # statistical error of figures of one run of six hours
(PSI, YAW_RATE, RUDDER, WAVE_YAW, ORBIT_NORTH, ORBIT_EAST, NORTH, EAST, SPEED) = range(9)
COLUMNS = 9


@compiled_here
def steer_north(rows, hull, ship, plain, series, delayed_rad):
    """Simulate a boat that steers north, and write `rows`; `plain` is the ship without orbital motion."""
    ships.begin_hull(hull, ship)
    for row in range(rows.shape[0]):
        out, step = rows[row], row * STEPS_PER_ROW
        out[PSI], out[YAW_RATE], out[SPEED] = hull[ships.PSI], hull[ships.YAW_RATE], hull[ships.NOW_SPEED]
        float_rad = ships.float_heading(hull, ship, series, step, 0.0)
        out[WAVE_YAW] = ships.heading(hull, ship, series, step, 0.0) - float_rad
        out[NORTH], out[EAST] = ships.velocity(hull, plain, series, step, 0.0)
        north_m_s, east_m_s = ships.velocity(hull, ship, series, step, 0.0)
        out[ORBIT_NORTH], out[ORBIT_EAST] = north_m_s - out[NORTH], east_m_s - out[EAST]
        rudder_rad = min(max(-GAIN * hull[ships.PSI], -LIMIT_RAD), LIMIT_RAD)
        for substep in range(STEPS_PER_ROW):
            effective_rad = ships.rudder_in_water(ship, delayed_rad, step + substep, rudder_rad)
            out[RUDDER] += 0.5 * (hull[ships.RUDDER] + effective_rad) / STEPS_PER_ROW
            ships.step_hull(hull, ship, series, step + substep, effective_rad)


def spectrum_in_band(values):
    """Return the mean of the one-sided spectrum from 0.02 to 0.04 Hz, below that of all waves."""
    from scipy.signal import welch  # noqa: PLC0415 - takes a second to import

    frequency_hz, power = welch(values, fs=1.0 / ROW_S, nperseg=4000)
    return float(np.mean(power[(frequency_hz >= 0.02) & (frequency_hz <= 0.04)]))


def memory_s(values, step_s):
    """Return the time constant of a first-order process, from its correlation over a step."""
    return -step_s / math.log(np.corrcoef(values[:-1], values[1:])[0, 1]) if np.ptp(values) > 0.0 else math.nan


def period_and_damping(series, first):
    """Return period of the spectral peak and damping of a process of angle and rate in the series."""
    process = series[first : first + 2 * round(SECONDS / ships.GRID_S)].reshape(-1, 2)
    transition = np.linalg.lstsq(process[:-1], process[1:], rcond=None)[0]
    root_1_s = np.log(np.linalg.eigvals(transition).astype(complex))[0] / ships.GRID_S
    damping = -root_1_s.real / abs(root_1_s)
    return 2.0 * math.pi / abs(root_1_s) / math.sqrt(1.0 - 2.0 * damping**2), damping


@cache
def sea_figures(name):
    """Return the figures of a sea, angles in degrees; NaN if the sea has no such property."""
    scenario = parse_scenario(name)
    sea = draw_sea(scenario, 1, SECONDS)
    ship, series = sea.ship, sea.series
    rows, delayed_rad = np.zeros((round(SECONDS / ROW_S), COLUMNS)), np.zeros(max(ship.delay_steps, 1))
    plain = sailing.record_of(ship._replace(has_crests=False, has_orbit=False))
    steer_north(rows, np.zeros(ships.HULL_STATES), sailing.record_of(ship), plain, series, delayed_rad)
    ratio = ship.speed_m_s / ship.model_speed_m_s
    ability_1_s, lag_s = ship.ability_1_s * ratio, ship.lag_s / ratio
    # The residual of the K-T equation over a row, without its cubic term, is disturbance plus bias.
    residual_rad = lag_s * np.diff(rows[:, YAW_RATE]) + np.diff(rows[:, PSI]) - ability_1_s * ROW_S * rows[:-1, RUDDER]
    none_known = math.nan, math.nan
    wave_period_s, wave_damping = period_and_damping(series, ship.yaw_at) if ship.has_yaw else none_known
    orbit_at = ship.beside_at if ship.has_crests else ship.orbit_at
    orbit_period_s, _ = period_and_damping(series, orbit_at) if ship.has_crests or ship.has_orbit else none_known
    bias = offset_of(scenario, 1, round(BIAS_SECONDS / ships.GRID_S))
    bias_rad = np.empty(bias.size)
    bias.fill(bias_rad)
    half_minutes = rows.reshape(-1, 300, COLUMNS).mean(1)
    course_rad = np.arctan2(half_minutes[:, EAST], half_minutes[:, NORTH])
    return {
        "rate_spectrum": spectrum_in_band(np.degrees(rows[:, YAW_RATE])),
        "diffusion": spectrum_in_band(np.degrees(residual_rad) / ROW_S) / 2.0,
        "wave_yaw": float(np.degrees(np.std(rows[:, WAVE_YAW]))),
        "wave_period": wave_period_s,
        "wave_damping": wave_damping,
        "orbit": float(np.sqrt(np.mean(np.var(rows[:, [ORBIT_NORTH, ORBIT_EAST]], axis=0)))),
        "orbit_period": orbit_period_s,
        "bias": float(np.degrees(np.std(bias_rad))),
        "bias_memory": memory_s(bias_rad[::500], 500 * ships.GRID_S),
        "receiver_filter": (scenario.disturbances.receiver or DEFAULT_RECEIVER).filter_s,
        "receiver_noise": (scenario.disturbances.receiver or DEFAULT_RECEIVER).noise_m_s,
        "speed_sd": float(np.std(rows[:, SPEED])),
        "speed_memory": memory_s(rows[::50, SPEED], 50 * ROW_S),
        "course": float(np.degrees(np.median(course_rad - half_minutes[:, PSI]))),
    }


@pytest.mark.parametrize("name", RECORDED_LIKE)
def test_recorded_seas_have_the_recorded_properties(name):
    # With the same D, this controller leaves two thirds of the spectrum that the recorded controller leaves.
    result = sea_figures(name) | {"rate_spectrum": 1.5 * sea_figures(name)["rate_spectrum"]}
    for figure, (low, high) in RECORDED.items():
        assert low - RELATIVE_TOLERANCE * abs(low) <= result[figure] <= high + RELATIVE_TOLERANCE * abs(high), figure


@pytest.mark.parametrize("name", OTHER_SEAS)
def test_other_seas_have_no_heading_diffusion(name):
    assert sea_figures(name)["diffusion"] < (0.45 if name == "gusts" else 0.1)
    assert sea_figures(name)["rate_spectrum"] < (0.9 if name == "gusts" else 0.15)


def ranges(text):
    """Return the numbers of a cell such as "0.4" or "0.4 to 10"; none for "-"."""
    return [] if text == "-" else [float(number) for number in text.split(" to ")]


def test_page_contains_the_figures():
    lines = (ROOT / "docs/explanation/physics.md").read_text(encoding="utf-8").splitlines()
    first = next(index for index, line in enumerate(lines) if line.startswith("| quantity | recorded |"))
    rows = [[cell.strip() for cell in line.split("|")[2:-1]] for line in lines[first + 2 : first + 2 + len(RECORDED)]]
    for (figure, limits), (values, *recorded_like, other_seas) in zip(RECORDED.items(), rows, strict=True):
        assert ranges(values) == sorted(set(limits)), figure
        for name, cell in zip(RECORDED_LIKE, recorded_like, strict=True):
            assert ranges(cell) == pytest.approx([sea_figures(name)[figure]], rel=0.06), (figure, name)
        result = [value for name in OTHER_SEAS if not math.isnan(value := sea_figures(name)[figure])]
        assert ranges(other_seas) == pytest.approx([min(result), max(result)], rel=0.06, abs=0.005), figure
