"""Synthetic recordings of a small wave-propelled vessel with their true heading, for `rambler-hil estimate`."""

import math
from types import SimpleNamespace

import numpy as np

START_DEG = (63.4, 10.4)
EARTH_M = 6_371_000.0
FINE_S = 0.05
K, T, SPEED_M_S, CURRENT_M_S = 0.049, 4.0, 0.5, 0.15  # K [1/s], T [s]; the current sets north


def coloured(rng, sd, period_s, damping, count):
    """Return noise of a second-order system with this standard deviation, period and damping."""
    from scipy.signal import cont2discrete, lfilter  # noqa: PLC0415 - takes a second to import

    omega = 2.0 * math.pi / period_s
    top, bottom, _ = cont2discrete(([1.0], [1.0, 2.0 * damping * omega, omega**2]), FINE_S)
    noise = lfilter(top.ravel(), bottom, rng.standard_normal(count + 4000))[4000:]
    return sd * noise / np.std(noise)


def random_bias(rng, sd, memory_s, count):
    from scipy.signal import lfilter  # noqa: PLC0415 - takes a second to import

    keep = math.exp(-FINE_S / memory_s)
    return lfilter([math.sqrt(1.0 - keep**2)], [1.0, -keep], sd * rng.standard_normal(count))


def sea(seconds=400.0, rate_hz=2.0, diffusion=2.0, wave_deg=1.1, seed=1, leg_s=200.0):
    """Return the columns of a recording by name, the heading without wave yaw, and the goal.

    A proportional controller steers, and its goal turns by 60 deg every leg. `diffusion`: of the heading [deg^2/s].
    """
    rng, count = np.random.default_rng(seed), int(seconds / FINE_S)
    wave = coloured(rng, math.radians(wave_deg), 2.5, 0.18, count)
    bias = math.radians(3.0) + random_bias(rng, math.radians(2.0), 900.0, count)
    disturbances = math.radians(math.sqrt(diffusion)) / T * math.sqrt(FINE_S) * rng.standard_normal(count)
    psi, rate, rudder, rows = 0.5, 0.0, 0.0, []
    row_steps, steering_steps = round(1.0 / rate_hz / FINE_S), round(0.5 / FINE_S)
    north = east = 0.0
    for step in range(count):
        now_s = step * FINE_S
        goal = 0.5 + math.radians(60.0) * (now_s // leg_s)
        if step % steering_steps == 0:
            error = math.remainder(goal - psi - wave[step], math.tau)
            rudder = float(np.clip(1.15 * error + math.radians(3.0), -0.52, 0.52))
        velocity = (SPEED_M_S * math.cos(psi) + CURRENT_M_S, SPEED_M_S * math.sin(psi))
        if step % row_steps == 0:
            rows.append((now_s, psi, wave[step], rudder, north, east, *velocity, goal))
        rate += FINE_S * (K * (rudder - bias[step]) - rate) / T + disturbances[step]
        psi += FINE_S * rate
        north, east = north + FINE_S * velocity[0], east + FINE_S * velocity[1]
    time_s, hull, waves, rudder, north, east, v_north, v_east, goal = np.array(rows).T
    noise = math.radians(0.05) * rng.standard_normal(time_s.size)
    columns = {
        "time_s": time_s,
        "heading_rad": (hull + waves + noise) % math.tau,
        "rudder_rad": rudder,
        "lat_deg": START_DEG[0] + np.degrees(north / EARTH_M),
        "lon_deg": START_DEG[1] + np.degrees(east / EARTH_M / math.cos(math.radians(START_DEG[0]))),
        "sog_m_s": np.hypot(v_north, v_east),
        "cog_deg": np.degrees(np.arctan2(v_east, v_north)) % 360.0,
    }
    return SimpleNamespace(columns=columns, hull_rad=hull, goal_rad=goal)


def text_of(columns):
    """Return columns as a CSV; NaN is an empty cell."""
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(map(cell_of, row)) for row in rows)]) + "\n"


def cell_of(value):
    return value if isinstance(value, str) else "" if math.isnan(value) else f"{value:.9g}"
