"""The wave filter in simulated seas and on real recordings: what it finds, and how honest it is about it."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from msgspec.structs import replace

from firmware_py.common.angles import radians, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.devices import decode
from firmware_py.estimate import kalman
from firmware_py.estimate.wave_filter import (
    HEADING_LIMIT,
    Heading,
    Velocity,
    carry_on,
    correct_heading,
    correct_velocity,
    predict_heading,
    update,
)
from firmware_py.estimate.wave_filter_state import WaveFilterSettings, WaveFilterState, start
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel, rk4_step
from hil.ship.drift import RudderDrift
from hil.ship.noise import NormalNumbers
from hil.ship.waves import WaveYaw
from support.paths import DATA

SETTINGS = WaveFilterSettings.of(ParameterSet())


@dataclass
class Sea:
    """A boat under a weaving rudder in waves, with compass and receiver."""

    speed_m_s: float = 0.7
    period_s: float = 8.0
    spread_deg: float = 20.0
    bias_deg: float = 5.0
    drift_deg: float = 2.0
    current: tuple[float, float] = (0.0, 0.3)
    receiver: bool = True
    orbital_m_s: float = 0.0
    weave_rad: float = 0.1
    factor: float = 1.0
    seed: int = 1
    normalised: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    claimed: list[float] = field(default_factory=list)

    def sail(self, seconds, state=None):
        rng = np.random.default_rng(self.seed)
        waves = WaveYaw(
            radians(self.spread_deg), self.period_s, 0.1, NormalNumbers(np.random.default_rng(self.seed + 1))
        )
        drift = RudderDrift(radians(self.drift_deg), 0.1, NormalNumbers(np.random.default_rng(self.seed + 2)))
        ship = OCEAN_RAMBLER.at_speed(self.speed_m_s)
        state = state or WaveFilterState()
        heading = rate = 0.0
        noise = rng.standard_normal((round(seconds * 10), 3))
        for tick in range(round(seconds * 10)):
            t_s = 0.1 * tick
            reading = round(math.degrees(heading + waves.angle_rad(0.0)) + 0.3 * noise[tick, 0], 1)
            velocities = []
            if self.receiver and tick % 10 == 5:
                swing = self.orbital_m_s / radians(max(self.spread_deg, 1.0))
                north = self.speed_m_s * math.cos(heading) + self.current[0] + 0.03 * noise[tick, 1]
                east = self.speed_m_s * math.sin(heading) + self.current[1] + 0.03 * noise[tick, 2]
                east += swing * waves.angle_rad(0.0)
                velocities = [Velocity(t_s, math.hypot(north, east), math.atan2(east, north))]
            rudder = radians(self.bias_deg) + self.weave_rad * (1.0 if math.sin(t_s / 25.0) > 0.0 else -1.0)
            headings = [Heading(t_s, radians(reading) % (2.0 * math.pi))]
            state = update(SETTINGS, state, headings, velocities, rudder)
            if tick > 600:
                self.normalised.append(state.innovation_rad / state.innovation_sd_rad)
                self.errors.append(wrap_pi(state.x[0] - heading))
                self.claimed.append(state.spread(kalman.HEADING))
            offset = radians(self.bias_deg) + drift.angle_rad
            heading, rate = rk4_step(
                heading,
                rate,
                rudder,
                0.1,
                ship.turning_ability_1_s * self.factor,
                ship.turning_lag_s,
                ship.norrbin_s2,
                offset,
            )
            waves.step()
            drift.step()
        return state


def rms_deg(values):
    return math.degrees(float(np.sqrt(np.mean(np.square(values)))))


SEAS = {
    "sea": Sea(0.9, 6.0, 4.0),
    "swell": Sea(0.7, 8.0, 20.0, current=(0.0, 0.0)),
    "short chop": Sea(1.2, 2.5, 8.0, seed=5),
    "long and slow": Sea(0.3, 10.0, 12.0, seed=9),
}


@pytest.mark.parametrize("name", SEAS)
def test_it_finds_the_waves_and_is_honest(name):
    sea = SEAS[name]
    state = sea.sail(500.0)
    assert 2.0 * math.pi / state.noise_model.omega_rad_s == pytest.approx(sea.period_s, rel=0.12)
    assert math.degrees(state.noise_model.wave_spread_rad) == pytest.approx(sea.spread_deg, rel=0.35)
    assert math.degrees(math.exp(0.5 * state.noise_model.log_noise)) == pytest.approx(0.3, abs=0.1)
    z = np.array(sea.normalised)
    # The 99 % band of a chi-square with so many degrees of freedom, divided by their number.
    band = 2.58 * math.sqrt(2.0 / z.size)
    assert abs(np.mean(z * z) - 1.0) < max(band, 0.05)
    assert abs(np.mean(z[1:] * z[:-1])) < 0.06
    assert abs(np.mean(z)) < 0.05
    # What it claims of its own error is so, within the few independent errors of a short run.
    assert 0.5 < rms_deg(sea.errors) / rms_deg(sea.claimed) < 1.7
    assert rms_deg(sea.errors) < 0.25 * sea.spread_deg + 0.8
    assert state.x[kalman.SPEED] == pytest.approx(sea.speed_m_s, abs=0.12)
    assert state.x[kalman.EAST] == pytest.approx(sea.current[1], abs=0.12)


def test_a_receiver_that_shows_the_motion_of_the_waves_is_seen_through():
    still, swung, blind = Sea(period_s=7.0), Sea(period_s=7.0, orbital_m_s=0.5), Sea(period_s=7.0, receiver=False)
    quiet, rough = still.sail(300.0), swung.sail(300.0)
    blind.sail(300.0)
    assert quiet.noise_model.orbit_m_s < 0.05
    # It swings along one axis only; what is told is for both.
    assert rough.noise_model.orbit_m_s == pytest.approx(0.5 * math.sqrt(0.5), rel=0.4)
    assert math.exp(0.5 * rough.noise_model.log_velocity_noise) < 0.1
    assert rms_deg(still.errors) < rms_deg(blind.errors)
    # In step with the yaw, which is found out: so it does good and no harm.
    by_angle = rough.noise_model.coupling.shares[2]
    assert by_angle == pytest.approx(0.5 / radians(20.0), rel=0.15)
    assert rms_deg(swung.errors) < 0.8 * rms_deg(blind.errors)


def test_a_boat_that_turns_better_than_her_model_is_found_out():
    state = Sea(0.9, 6.0, 4.0, factor=1.3, weave_rad=0.2).sail(400.0)
    assert state.x[kalman.FACTOR] == pytest.approx(1.3, abs=0.12)


def test_without_a_receiver_how_she_turns_tells_the_product_of_speed_and_factor():
    sea = Sea(0.8, 5.0, 5.0, receiver=False, weave_rad=0.25)
    state = sea.sail(500.0)
    assert state.x[kalman.SPEED] * state.x[kalman.FACTOR] == pytest.approx(0.8, rel=0.15)


@pytest.mark.parametrize("name", ["gpsd_bundg_zeus_9.nmea", "avnav_20160815_excerpt.nmea"])
def test_it_is_honest_about_real_headings(name):
    path = DATA / "nmea" / name
    if not path.exists():
        pytest.skip("the recordings of tests/data are not here")
    # Yachts of which only the order of magnitude is known: some 2 to 3 m/s, turn as such yachts do.
    parameters = ParameterSet()
    for parameter, value in (("MDL_K", 0.3), ("MDL_T_S", 1.5), ("MDL_SPEED", 2.2), ("MDL_ALPHA_S2", 0.0)):
        parameters = parameters.replaced(parameter, value)
    settings, state = WaveFilterSettings.of(parameters), WaveFilterState()
    rudder_rad, count, normalised = 0.0, 0, []
    for result in decode("nmea", path.read_bytes()):
        if result.get("rudder_deg") is not None:
            rudder_rad = radians(result["rudder_deg"])
        if result["type"] != "heading" or result.get("true_deg", result.get("magnetic_deg")) is None:
            continue
        heading_deg = result.get("true_deg") if result.get("true_deg") is not None else result["magnetic_deg"]
        state = update(settings, state, [Heading(0.1 * count, radians(heading_deg))], [], rudder_rad)
        count += 1
        if count > 600:
            normalised.append(state.innovation_rad / state.innovation_sd_rad)
    assert count > 1400
    assert state.refusals == 0
    # A jump, of a degree twice in one of them, counts as the filter counts it.
    z = np.clip(normalised, -HEADING_LIMIT, HEADING_LIMIT)
    # The 95 % band of a chi-square with so many degrees of freedom, divided by their number, once the first minute has
    # told the sea; these compasses smooth and round.
    assert abs(np.mean(z * z) - 1.0) < 1.96 * math.sqrt(2.0 / z.size)
    assert abs(np.mean(z[1:] * z[:-1])) / np.mean(z * z) < 0.25


def test_late_and_missing_samples_do_it_no_harm():
    state = start(WaveFilterState(), 0.0, 1.0)
    for tick in range(1, 300):
        if tick % 7:
            t_s = 0.1 * tick
            state = correct_heading(SETTINGS, state, t_s, 1.0)
    before = state
    # One that was overtaken by later ones still tells a little; one too old tells nothing.
    assert correct_heading(SETTINGS, state, state.t_s - 0.25, 1.0).t_s == state.t_s
    assert correct_heading(SETTINGS, state, state.t_s - 5.0, 3.0) is before
    later = correct_heading(SETTINGS, state, state.t_s + 30.0, 1.0)
    assert later.t_s == pytest.approx(state.t_s + 30.0)
    assert wrap_pi(later.x[0] - 1.0) == pytest.approx(0.0, abs=0.2)
    anew = correct_heading(SETTINGS, state, state.t_s + 700.0, 2.0)
    assert anew.x[0] == pytest.approx(2.0)
    assert anew.noise_model == state.noise_model


def test_fixes_that_have_waited_together_are_taken_and_teach_nothing_about_their_noise():
    state = start(WaveFilterState(), 0.0, 1.0)
    first = correct_velocity(SETTINGS, state, 1.0, 0.4, 1.0)
    second = correct_velocity(SETTINGS, first, 1.0, 0.5, 1.1)
    assert second.x != first.x
    assert second.noise_model.velocities == first.noise_model.velocities
    earlier = correct_velocity(SETTINGS, second, 0.5, 0.5, 1.1)
    assert all(map(math.isfinite, earlier.x))


def test_a_jump_is_refused_and_counted():
    state = start(WaveFilterState(), 0.0, 1.0)
    for tick in range(1, 300):
        state = correct_heading(SETTINGS, state, 0.1 * tick, 1.0)
    for tick in range(300, 310):
        state = correct_heading(SETTINGS, state, 0.1 * tick, 1.0 + math.pi)
    assert state.refusals == 10
    assert wrap_pi(predict_heading(SETTINGS, state, 31.0)[0] - 1.0) == pytest.approx(0.0, abs=0.1)
    assert correct_heading(SETTINGS, state, 31.0, 1.0).refusals == 0


@pytest.mark.parametrize(("ability", "lag"), [(0.3, 1.0), (0.3, 3.0), (0.5, 0.7), (0.2, 0.5)])
def test_a_nimble_boat_that_turns_as_she_wakes_up_is_where_her_compass_shows_her(ability, lag):
    """Taken for one above which a slow float hangs, she was thought 16 to 37 degrees ahead of it."""
    model = OCEAN_RAMBLER._replace(turning_ability_1_s=ability, turning_lag_s=lag, norrbin_s2=0.0)
    settings, state, heading, rate, errors = WaveFilterSettings(model), WaveFilterState(), 0.0, 0.0, []
    numbers = np.random.default_rng(7)
    for tick in range(600):
        rudder = radians(30.0) * (tick > 5) * (1.0 if tick < 60 else -1.0 if tick < 90 else 0.0)
        shown = Heading(0.1 * tick, (heading + radians(0.3) * numbers.standard_normal()) % (2.0 * math.pi))
        state = update(settings, state, [shown], [], rudder)
        errors.append(wrap_pi(state.x[kalman.HEADING] - heading))
        heading, rate = rk4_step(heading, rate, rudder, 0.1, ability, lag, 0.0, 0.0)
    assert np.degrees(np.abs(errors)).max() < 7.0


def test_what_a_float_has_shown_of_itself_is_kept_through_a_long_silence():
    settings = WaveFilterSettings(OCEAN_RAMBLER._replace(turning_ability_1_s=0.2))
    state = correct_heading(settings, WaveFilterState(), 0.0, 1.0)
    assert state.noise_model.follow_rad_s == pytest.approx(3.2)
    learned = replace(state.noise_model, log_follow=math.log(0.4), follow_information=1.0)
    anew = correct_heading(settings, replace(state, noise_model=learned), 1000.0, 1.0)
    assert anew.noise_model.follow_rad_s == pytest.approx(0.4)
    assert correct_heading(SETTINGS, WaveFilterState(), 0.0, 1.0).noise_model.follow_rad_s == pytest.approx(0.8)


def test_no_rudder_bias_is_larger_than_a_rudder_stands():
    """Of a boat that goes round against her rudder: it was 70 deg, and swung a boat with a slow float for good."""
    state, biases = WaveFilterState(), []
    for tick in range(3000):
        state = update(SETTINGS, state, [Heading(0.1 * tick, -0.0035 * tick % (2.0 * math.pi))], [], radians(30.0))
        biases.append((state.x[kalman.BIAS], state.x[kalman.BIAS_MEAN]))
    assert np.degrees(np.abs(biases)).max() == pytest.approx(30.0)


def test_no_turn_is_taken_for_waves():
    """A boat that circles against its rudder, to and fro: the yaw of the waves made up for more than half a turn."""
    waves = WaveYaw(radians(20.0), 8.0, 0.1, NormalNumbers(np.random.default_rng(1)))
    state, headings, turned_rad = WaveFilterState(), [], np.zeros(4000)
    for tick in range(4000):
        side = math.copysign(1.0, math.sin(0.005 * tick)) if tick > 600 else 0.0
        turned_rad[tick] = turned_rad[tick - 1] - 0.0075 * side
        shown = Heading(0.1 * tick, turned_rad[tick] + waves.angle_rad(0.0))
        state = update(SETTINGS, state, [shown], [], radians(30.0) * side)
        waves.step()
        headings.append(state.x[kalman.HEADING])
    errors = np.degrees(np.unwrap(headings) - turned_rad)
    assert np.abs(errors).max() < 100.0
    assert abs(errors[-1]) < 60.0  # 41 in the mean of twelve seeds: what she is thought to do is wrong all the while


@pytest.mark.parametrize("odd", [math.nan, math.inf, -math.inf, 1e300])
def test_what_is_no_number_changes_nothing(odd):
    state = start(WaveFilterState(), 0.0, 1.0)
    if not abs(odd) < math.inf:
        assert correct_heading(SETTINGS, state, 0.1, odd) is state
        assert correct_heading(SETTINGS, state, odd, 1.0) is state
        assert correct_velocity(SETTINGS, state, 0.1, 0.5, odd) is state
    assert correct_velocity(SETTINGS, state, 0.1, odd, 0.5) is state
    assert correct_velocity(SETTINGS, state, odd, 0.5, 0.5) is state
    assert correct_velocity(SETTINGS, WaveFilterState(), 0.1, 0.5, 0.5) == WaveFilterState()


def test_what_is_known_of_the_water_is_read_in_one_piece():
    numbers = np.arange(kalman.STATES**2, dtype=float).reshape(kalman.STATES, kalman.STATES)
    state = WaveFilterState(p=numbers.tobytes())
    n, e, u = kalman.NORTH, kalman.EAST, kalman.SPEED
    pairs = ((n, n), (n, e), (n, u), (e, e), (e, u), (u, u))
    assert state.water_covariance() == tuple(state.covariance(*pair) for pair in pairs)
    assert state.water_covariance() == tuple(numbers[pair] for pair in pairs)


@pytest.mark.parametrize("size", [-8, 8, 144])
def test_a_state_of_another_size_is_refused(size):
    """As a log may hold one: it must not be read askew."""
    state = start(WaveFilterState(), 0.0, 1.0)
    with pytest.raises(ValueError, match="size"):
        correct_heading(SETTINGS, replace(state, p=(state.p + bytes(144))[: len(state.p) + size]), 0.1, 1.0)


@pytest.mark.parametrize(("ability", "lag", "norrbin"), [(4.0, 19.0, 1e3), (1.0, 0.05, 1e3), (20.0, 0.05, 1e6)])
def test_a_model_far_too_lively_for_the_boat_starts_it_anew_and_ends_nothing(ability, lag, norrbin):
    chances = np.random.default_rng(1)
    settings = replace(SETTINGS, model=KtModel(ability, lag, norrbin, 0.0, 0.1))
    state, heading_rad, t_s = WaveFilterState(), 1.0, 0.0
    for _ in range(100):
        t_s += chances.choice([0.1, 0.03, 1.0, 10.0])
        heading_rad += chances.normal(0.0, 0.3)
        fixes = [Velocity(t_s, chances.uniform(0.0, 2.0), chances.uniform(0.0, 6.0))]
        shown = [Heading(t_s, heading_rad % 6.28)]
        state = update(settings, state, shown, fixes, chances.uniform(-0.6, 0.6))
        if state.x:
            assert math.isfinite(sum(state.x))
            carry_on(settings, state, t_s + 10.0)
            predict_heading(settings, state, t_s + 10.0)


def test_a_long_calm_leaves_the_covariance_sound():
    state = start(WaveFilterState(), 0.0, 1.0)
    for tick in range(1, 4000):
        state = correct_heading(SETTINGS, state, 0.1 * tick + (100.0 if tick > 2000 else 0.0), 1.0)
    matrix = np.frombuffer(state.p).reshape(kalman.STATES, kalman.STATES)
    scale = np.sqrt(np.diag(matrix))
    assert np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min() > -1e-9
    assert math.isfinite(sum(state.x))
