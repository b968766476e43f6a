"""Draw a sea for the compiled loop: the same numbers, from the same streams and in the same order, as hil/ship."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import TWO_PI, radians
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.devices.nmea_gps import NOISE_TIME_S, POSITION_NOISE_M, Gaps
from hil.lab.compiled import compiled
from hil.lab.normals import draw_normals, fill, state_of
from hil.lab.twin.devices import EAST_ERROR_M_S, FIX_NUMBERS, NO_FIX, NORTH_ERROR_M, NORTH_ERROR_M_S, Devices
from hil.lab.twin.plant import Sea
from hil.lab.twin.ship import GRID_S, STEPS_PER_SECOND, Floats, Ship
from hil.ship import drift, gusts
from hil.ship import wave_speed as wave_speeds
from hil.ship.disturbances import Bias, Compass, Leeway, OwnWaves, Receiver
from hil.ship.float_body import transition
from hil.ship.kt_plant import inner_steps
from hil.ship.manoeuvring import sway_ratios
from hil.ship.noise import BLOCK_SIZE, Stream, generator
from hil.ship.regressions import FLOAT, sway_model
from hil.ship.scenarios import Scenario
from hil.ship.waves import DAMPING, discretise, natural_frequency
from hil.ship.yaw_noise import jump_rad, largest_rate_rad_s
from hil.sim.device_factory import FREQUENCY_ERROR_PPM, POSITION_RATE_HZ
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG


class Part(NamedTuple):
    """A part of the series: its size and the function that computes it into an array."""

    size: int
    fill: Callable[[Floats], None]


def fill_zeros(out: Floats) -> None:
    """Set all values to zero."""
    out[:] = 0.0


@compiled
def wave_process(
    sds: tuple[float, float], a: tuple[tuple[float, float], tuple[float, float]], n: tuple[float, float, float],
    state: NDArray[np.uint64], out: Floats,
) -> None:  # fmt: skip
    """Compute angle and rate of a wave process into `out`, alternately.

    `sds`: initial standard deviations. `a`, `n`: transition and noise of a step (hil.ship.waves.discretise).
    """
    # NormalNumbers returns the numbers of each block in reverse order.
    numbers, y, v = np.empty(BLOCK_SIZE), 0.0, 0.0
    for k in range(out.size // 2):
        index = BLOCK_SIZE - 1 - 2 * k % BLOCK_SIZE
        if index == BLOCK_SIZE - 1:
            fill(state, numbers)
        first, second = numbers[index], numbers[index - 1]
        if k == 0:
            y, v = sds[0] * first, sds[1] * second
        else:
            y, v = a[0][0] * y + a[0][1] * v + n[0] * first, a[1][0] * y + a[1][1] * v + n[1] * first + n[2] * second
        out[2 * k], out[2 * k + 1] = y, v


@compiled
def gauss_markov(first: float, keep: float, step_sd: float, state: NDArray[np.uint64], out: Floats) -> None:
    """Compute a first-order Gauss-Markov process with mean 0 into `out`; `first` is its initial standard deviation."""
    numbers, value = np.empty(BLOCK_SIZE), 0.0
    for k in range(out.size):
        index = BLOCK_SIZE - 1 - k % BLOCK_SIZE
        if index == BLOCK_SIZE - 1:
            fill(state, numbers)
        value = first * numbers[index] if k == 0 else keep * value + step_sd * numbers[index]
        out[k] = value


@compiled
def first_order(first: float, keep: float, step_sd: float, out: Floats) -> None:
    """Replace the normal numbers in `out` by the first-order process that they drive, with the start value `first`."""
    value = first
    for k in range(out.size):
        value = keep * value + step_sd * out[k]
        out[k] = value


@compiled
def calm_period(decay: float, calm_at_s: float, calm_until_s: float, out: Floats) -> None:
    """Compute the relative wave height, with a calm period, into `out`."""
    out[0] = 1.0
    for k in range(1, out.size):
        level = 0.0 if calm_at_s <= k * GRID_S < calm_until_s else 1.0
        out[k] = level + decay * (out[k - 1] - level)


@compiled
def add_gust(begin: int, end: int, peak_rad: float, out: Floats) -> None:
    """Add a gust of the shape 1 - cos to `out`, from step `begin` to `end`."""
    for k in range(begin, min(end, out.size)):
        out[k] += 0.5 * peak_rad * (1.0 - math.cos(TWO_PI * (k - begin) / (end - begin)))


COMPASS_NOISE_DEG = 0.3
COMPASS_PERIOD_S, FIX_PERIOD_S = 0.1, 1.0
DEFAULT_RECEIVER = Receiver(latency_s=0.06, lost=0.0, gap_s=10.0, filter_s=0.0, noise_m_s=0.03)
NO_TRANSITION = ((0.0, 0.0), (0.0, 0.0))


EMPTY_PART, EMPTY_PROCESS = Part(1, fill_zeros), Part(2, fill_zeros)
NO_ARRAY = np.empty(0)


def process_of(sd: float, waves: OwnWaves, seed: int, stream: Stream, steps: int) -> Part:
    """Return the part with angle and rate of hil.ship.waves.WaveYaw at each grid step."""
    if sd <= 0.0:
        return EMPTY_PROCESS
    omega_rad_s = natural_frequency(waves.period_s, waves.damping)
    sds = (sd, sd * omega_rad_s)

    def fill_process(out: Floats) -> None:
        transition, noise = discretise(sds, omega_rad_s, GRID_S, waves.damping)
        wave_process(sds, transition, noise, state_of(generator(seed, stream)), out)

    return Part(2 * (steps + 2), fill_process)


def offset_of(scenario: Scenario, seed: int, steps: int) -> Part:
    """Return the part with the rudder offset by drift and gusts at each grid step."""
    bias = scenario.disturbances.bias or Bias(scenario.drift_deg, drift.TIME_CONSTANT_S)
    spread_rad, keep = radians(bias.sd_deg), math.exp(-GRID_S / bias.memory_s)

    def fill_offset(out: Floats) -> None:
        gauss_markov(
            spread_rad, keep, spread_rad * math.sqrt(1.0 - keep**2), state_of(generator(seed, Stream.DRIFT)), out
        )
        rng, end = generator(seed, Stream.GUSTS), 0
        while scenario.gust_deg and end <= steps:
            begin = end + round(rng.exponential(gusts.MEAN_PAUSE_S) / GRID_S)
            end = begin + max(1, round(rng.uniform(gusts.MIN_LENGTH_S, gusts.MAX_LENGTH_S) / GRID_S))
            add_gust(begin, end, radians(scenario.gust_deg) * math.sqrt(rng.exponential(1.0)), out)

    return Part(steps + 1, fill_offset)


def jumps_of(scenario: Scenario, seed: int, steps: int) -> Part:
    """Return the part with the jump of the yaw rate at the end of each grid step, times the turning lag."""
    if (yaw := scenario.disturbances.yaw) is None:
        return EMPTY_PART
    jump = jump_rad(yaw.diffusion_deg2_s, GRID_S)
    return Part(steps + 1, lambda out: gauss_markov(jump, 0.0, jump, state_of(generator(seed, Stream.YAW)), out))


def speed_of(scenario: Scenario, seed: int, steps: int) -> tuple[Part, Part]:
    """Return the parts with relative speed and relative wave height at each grid step."""
    wave_speed_options = scenario.disturbances.wave_speed
    if wave_speed_options is None:
        return EMPTY_PART, EMPTY_PART
    keep = math.exp(-GRID_S / wave_speed_options.memory_s)
    decay, calm_until_s = (
        math.exp(-GRID_S / wave_speeds.DECAY_S),
        wave_speed_options.calm_at_s + wave_speed_options.calm_for_s,
    )

    def fill_waves(out: Floats) -> None:
        calm_period(decay, wave_speed_options.calm_at_s, calm_until_s, out)

    def fill_speed(out: Floats) -> None:
        groups, waves = np.empty_like(out), np.empty_like(out)
        step_sd, state = wave_speed_options.spread * math.sqrt(1.0 - keep**2), state_of(generator(seed, Stream.SPEED))
        gauss_markov(wave_speed_options.spread, keep, step_sd, state, groups)
        fill_waves(waves)
        out[:] = waves * np.minimum(np.maximum(1.0 + groups, 0.0), wave_speeds.MAX_SPEED_RATIO)

    return Part(steps + 1, fill_speed), Part(steps + 1, fill_waves)


def _ship_model(scenario: Scenario, model: KtModel) -> tuple[KtModel, int]:
    """Return the model with the disturbances of ability, lag and bias, and the number of inner steps of a grid step."""
    disturbances = scenario.disturbances
    ability, lag = model.turning_ability_1_s, model.turning_lag_s
    if (other_ship := disturbances.other_ship) is not None:
        ability, lag = ability * other_ship.ability, lag * other_ship.lag
    bias_rad = model.rudder_offset_rad + radians(scenario.bias_deg)
    ship = model._replace(turning_ability_1_s=ability, turning_lag_s=lag, rudder_offset_rad=bias_rad)
    fastest_model = ship.at_speed(
        scenario.speed_m_s * (wave_speeds.MAX_SPEED_RATIO if disturbances.wave_speed else 1.0)
    )
    noise_rad_s = (
        largest_rate_rad_s(disturbances.yaw.diffusion_deg2_s, fastest_model.turning_lag_s) if disturbances.yaw else 0.0
    )
    return ship, inner_steps(fastest_model, GRID_S, disturbance_rad_s=noise_rad_s)


def ship_of(scenario: Scenario, model: KtModel, indices: Iterable[int]) -> Ship:
    """Return the constants of the hull and the indices of its series; raise ValueError for an invalid model."""
    disturbances = scenario.disturbances
    ship, inner = _ship_model(scenario, model)
    body, leeway = disturbances.float_body, disturbances.leeway or Leeway(0.0)
    (f00, f01), (f10, f11) = (
        NO_TRANSITION if body is None else transition(body.own_frequency_rad_s, body.damping, GRID_S)
    )
    drive, damping_1_m = sway_ratios(sway_model(FLOAT), 1.0)
    yaw_rad = radians(scenario.wave_yaw_deg)
    is_independent = is_orbit_independent(scenario)
    compass = disturbances.compass or Compass(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    toward_rad = radians(scenario.current_toward_deg)
    return Ship(
        ship.turning_ability_1_s,
        ship.turning_lag_s,
        model.norrbin_s2,
        model.speed_m_s,
        ship.rudder_offset_rad,
        scenario.speed_m_s,
        inner,
        GRID_S / inner,
        disturbances.wave_speed is not None,
        body is not None,
        f00,
        f01,
        f10,
        f11,
        0.0 if body is None else body.own_frequency_rad_s**2,
        0.0 if body is None else 2.0 * body.damping * body.own_frequency_rad_s,
        disturbances.leeway is not None or disturbances.slide is not None,
        radians(leeway.body_deg),
        radians(leeway.wind_deg),
        radians(leeway.wind_from_deg),
        0.0 if disturbances.slide is None else disturbances.slide.share,
        drive,
        damping_1_m,
        disturbances.orbital is not None,
        is_independent,
        1.0 if is_independent else 1.0 / yaw_rad,
        *_crests_m(scenario),
        radians(scenario.waves_toward_deg),
        scenario.orbital_m_s > 0.0 and scenario.wave_period_s > 0.0,
        disturbances.compass is not None,
        *_deviation(compass),
        compass.lag_s,
        1.0 if compass.lag_s <= 0.0 else -math.expm1(-GRID_S / compass.lag_s),
        0 if disturbances.delay is None else round(disturbances.delay.delay_s / GRID_S),
        scenario.current_m_s * math.cos(toward_rad),
        scenario.current_m_s * math.sin(toward_rad),
        scenario.tide_s,
        scenario.tide_rotary,
        yaw_rad > 0.0,
        _heel_rad(scenario) > 0.0,
        disturbances.yaw is not None,
        *indices,
    )


def is_orbit_independent(scenario: Scenario) -> bool:
    """Return whether the orbital motion is independent of the wave yaw."""
    return not scenario.wave_yaw_deg > 0.0 or scenario.disturbances.own_waves is not None


def _crests_m(scenario: Scenario) -> tuple[float, float]:
    """Return the standard deviations of the receiver's displacement along and across a short-crested sea."""
    orbital = scenario.disturbances.orbital
    if orbital is None:
        return 0.0, 0.0
    spread_m, spread_rad = orbital.velocity_m_s * scenario.wave_period_s / TWO_PI, radians(orbital.spread_deg)
    across_fraction = math.sqrt(0.5 * -math.expm1(-2.0 * spread_rad * spread_rad))
    return spread_m * math.sqrt(1.0 - across_fraction * across_fraction), spread_m * across_fraction


def _deviation(compass: Compass) -> tuple[float, float, float, float, float]:
    a, b, c, d, e = compass.a_deg, compass.b_deg, compass.c_deg, compass.d_deg, compass.e_deg
    return radians(a), radians(b), radians(c), radians(d), radians(e)


def _heel_rad(scenario: Scenario) -> float:
    compass = scenario.disturbances.compass
    return radians(compass.heel_deg) if compass is not None and scenario.wave_period_s > 0.0 else 0.0


def series_of(scenario: Scenario, seed: int, steps: int) -> tuple[Part, ...]:
    """Return the parts of the series at each grid step, in the order of the indices in Ship."""
    period_s, orbital = scenario.wave_period_s, scenario.disturbances.orbital
    waves = OwnWaves(period_s, DAMPING)
    crests = OwnWaves(period_s, DAMPING if orbital is None else orbital.damping)
    yaw_rad = radians(scenario.wave_yaw_deg)
    is_calm = scenario.orbital_m_s <= 0.0 or period_s <= 0.0
    orbit_m = 0.0 if is_calm else scenario.orbital_m_s * period_s / TWO_PI
    return (
        offset_of(scenario, seed, steps),
        process_of(yaw_rad, scenario.disturbances.own_waves or waves, seed, Stream.WAVES, steps),
        process_of(orbit_m, waves, seed, Stream.ORBIT, steps),
        EMPTY_PROCESS if orbital is None else process_of(1.0, crests, seed, Stream.ORBIT, steps),
        process_of(1.0, crests, seed, Stream.ORBIT_ALONE, steps)
        if orbital is not None and is_orbit_independent(scenario)
        else EMPTY_PROCESS,
        process_of(_heel_rad(scenario), waves, seed, Stream.ROLL, steps),
        *speed_of(scenario, seed, steps),
        jumps_of(scenario, seed, steps),
    )


def fixes_of(scenario: Scenario, seed: int, epochs: int, first_s: float, period_s: float) -> Floats:
    """Draw the random numbers of each fix, (epochs, FIX_NUMBERS)."""
    receiver = scenario.disturbances.receiver or DEFAULT_RECEIVER
    numbers = draw_normals(generator(seed, Stream.POSITION), 2 + 4 * epochs)
    steps, first_m = numbers[2:].reshape(-1, 4), 0.0 + POSITION_NOISE_M * numbers[:2]
    gaps, fixes = Gaps(receiver.lost, receiver.gap_s, generator(seed, Stream.GAPS)), np.zeros((epochs, FIX_NUMBERS))
    keep = math.exp(-1.0 / (POSITION_RATE_HZ * NOISE_TIME_S))
    for axis in range(2):
        errors_m = 0.0 + POSITION_NOISE_M * steps[:, axis]
        first_order(first_m[axis], keep, math.sqrt(1.0 - keep**2), errors_m)
        fixes[:, NORTH_ERROR_M + axis] = errors_m
    fixes[:, NORTH_ERROR_M_S : EAST_ERROR_M_S + 1] = 0.0 + receiver.noise_m_s * steps[:, 2:]
    for k in range(epochs if receiver.lost > 0.0 else 0):
        fixes[k, NO_FIX] = gaps.is_gap(first_s + k * period_s)
    return fixes


def devices_of(scenario: Scenario, seed: int, seconds: float, first: int) -> tuple[Devices, tuple[Part, Part]]:
    """Return the sampling times and the parts with the random numbers of the samples, which begin at index `first`."""
    rng = generator(seed, Stream.PHASES)
    compass_phase_s = float(rng.uniform(0.0, COMPASS_PERIOD_S))
    compass_ppm = float(rng.normal(0.0, FREQUENCY_ERROR_PPM))
    fix_phase_s = float(rng.uniform(0.0, FIX_PERIOD_S))
    fix_ppm = float(rng.normal(0.0, FREQUENCY_ERROR_PPM))
    fix_period_s = FIX_PERIOD_S / (1.0 + fix_ppm * 1e-6)
    fixes = fixes_of(scenario, seed, int(seconds) + 3, fix_phase_s, fix_period_s).ravel()
    headings = int(seconds * 10.01) + 20

    def fill_noise(out: Floats) -> None:
        fill(state_of(generator(seed, Stream.COMPASS)), out)
        out *= COMPASS_NOISE_DEG

    receiver = scenario.disturbances.receiver or DEFAULT_RECEIVER
    devices = Devices(
        compass_phase_s,
        COMPASS_PERIOD_S / (1.0 + compass_ppm * 1e-6),
        first,
        fix_phase_s,
        fix_period_s,
        first + headings,
        receiver.latency_s,
        receiver.filter_s,
        START_LATITUDE_DEG,
        START_LONGITUDE_DEG,
    )
    return devices, (Part(headings, fill_noise), Part(fixes.size, lambda out: np.copyto(out, fixes)))


def sea_of(
    scenario: Scenario, seed: int, seconds: float, model: KtModel = OCEAN_RAMBLER, buffer: Floats = NO_ARRAY
) -> Sea:
    """Draw the sea of a run; the series is stored in `buffer` if that is large enough."""
    steps = math.floor(seconds * STEPS_PER_SECOND) + 2 * STEPS_PER_SECOND
    parts = series_of(scenario, seed, steps)
    indices = np.cumsum([0, *(part.size for part in parts)]).tolist()
    devices, device_parts = devices_of(scenario, seed, seconds, indices[-1])
    size, at = indices[-1] + sum(part.size for part in device_parts), 0
    numbers = buffer if buffer.size >= size else np.empty(size)
    for part in (*parts, *device_parts):
        part.fill(numbers[at : at + part.size])
        at += part.size
    return Sea(ship_of(scenario, model, indices[:-1]), numbers, devices)
