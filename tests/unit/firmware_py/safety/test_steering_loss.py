import math
import random

import numpy as np
import pytest

from firmware_py.common.angles import radians
from firmware_py.model.kt import OCEAN_RAMBLER, decay_over
from firmware_py.safety.steering_loss import (
    INTERRUPTED,
    LOST,
    RECOVERED,
    RESPONSES,
    ResponseState,
    SteeringLossState,
    restart_after_gap,
    restart_all,
    update,
)

CORRELATION_S = 100.0
INITIAL_DISTURBANCE_RAD = math.radians(2.0)
MIN_GUST_RAD2_S = math.radians(6.0) ** 2
NOISE_SHARE = 0.7

SPEED_M_S, BLOCK_S, SD_RAD = 0.9, 2.0, radians(1.0)


class Boat:
    """A boat in wind with a delay in blocks, a share of its turning ability, and a multiple of its lag."""

    def __init__(
        self, turn_ratio=1.0, delay_blocks=0, lag_ratio=1.0, wind_rad=-0.09, speed_m_s=SPEED_M_S, sd_rad=SD_RAD
    ):
        self.state, self.rate_rad_s, self.rudders = SteeringLossState(), 0.0, [0.0] * delay_blocks
        self.turn_ratio, self.lag_ratio, self.wind_rad = turn_ratio, lag_ratio, wind_rad
        self.ship, self.speed_m_s, self.sd_rad = OCEAN_RAMBLER.at_speed(speed_m_s), speed_m_s, sd_rad
        self.diffusion_rad2_s = 0.0

    def block(self, rudder_rad, error_rad, noise_rad=0.0):
        """Simulate a block with a constant rudder; return the turn in it."""
        self.rudders.append(rudder_rad)
        steady_rad_s = self.ship.turning_ability_1_s * (self.turn_ratio * self.rudders.pop(0) + self.wind_rad)
        lag_s, change_rad_s = self.lag_ratio * self.ship.turning_lag_s, steady_rad_s - self.rate_rad_s
        decayed_rad_s = (1.0 - decay_over(BLOCK_S, lag_s)) * change_rad_s
        turned_rad = steady_rad_s * BLOCK_S - decayed_rad_s * lag_s + noise_rad
        self.rate_rad_s += decayed_rad_s
        self.state = update(
            OCEAN_RAMBLER, self.state, rudder_rad, turned_rad, BLOCK_S, self.sd_rad, self.speed_m_s, error_rad,
            self.diffusion_rad2_s,
        )  # fmt: skip
        return turned_rad

    def hold(self, seconds, rudder_rad, error_rad):
        """Simulate blocks with a constant rudder; return the time to a change of the verdict, or None."""
        previous = self.state.lost
        for block in range(round(seconds / BLOCK_S)):
            self.block(rudder_rad, error_rad)
            if self.state.lost is not previous:
                return (block + 1) * BLOCK_S
        return None


@pytest.mark.parametrize("error_rad", [-1.0, math.nan])
def test_turn_by_the_wind_is_no_response(error_rad):
    """The wind turns the boat to its goal, by a sixth of the turn by the rudder."""
    boat = Boat()
    assert boat.hold(120.0, radians(5.0), 0.0) is None
    boat.turn_ratio = 0.0
    assert 10.0 < boat.hold(60.0, radians(-28.5), error_rad) <= 50.0


@pytest.mark.parametrize("delay_blocks", [0, 1, 3, 6])
@pytest.mark.parametrize(
    ("turn_ratio", "lag_ratio"), [(0.5, 1.0), (1.0, 1.0), (2.0, 1.0), (1.0, 3.0), (0.5, 3.0), (-1.0, 1.0)]
)
def test_delayed_weak_or_opposite_response_is_a_response(turn_ratio, lag_ratio, delay_blocks):
    boat = Boat(turn_ratio, delay_blocks, lag_ratio)
    assert boat.hold(120.0, radians(5.0), 0.0) is None
    for side in (-1.0, 1.0, -1.0):
        assert boat.hold(60.0, radians(5.0 + side * 25.0), side) is None


@pytest.mark.parametrize("blocks", [1, 2])
@pytest.mark.parametrize("turned_deg", [-90.0, 60.0])
def test_turn_by_a_breaking_wave_is_no_loss_of_steering(turned_deg, blocks):
    boat = Boat()
    assert boat.hold(120.0, radians(5.0), 0.0) is None
    assert boat.hold(10.0, radians(28.5), 1.0) is None
    for _ in range(blocks):
        boat.block(radians(28.5), 1.0, radians(turned_deg) / blocks)
    assert boat.hold(120.0, radians(-28.5), -1.0) is None
    boat.turn_ratio = 0.0
    assert boat.hold(60.0, radians(-28.5), -1.0) is not None


def test_each_response_predicts_its_boat_and_needs_half_of_its_smallest_turn():
    parts = ((1.0, 0.6, (0, 2, 4, 6)), (0.5, 0.5, (0, 4)), (-1.0, -0.6, (0, 4)))
    kinds = [
        (part, smallest, lag_ratio, delay_blocks)
        for part, smallest, delays in parts
        for lag_ratio in (1.0, 3.0)
        for delay_blocks in delays
    ]
    for number, (part, min_turn_ratio, lag_ratio, delay_blocks) in enumerate(kinds):
        boat = Boat(part, delay_blocks, lag_ratio, wind_rad=0.0)
        boat.hold(40.0, radians(20.0), math.nan)
        assert boat.state.boats[number].residual_rad == pytest.approx(0.0, abs=1e-9)
        for share, against in ((0.49, True), (0.51, False)):
            boat = Boat(share * min_turn_ratio, delay_blocks, lag_ratio, wind_rad=0.0)
            boat.hold((delay_blocks + 1) * BLOCK_S, radians(20.0), math.nan)
            assert (boat.state.boats[number].evidence > 0.0) is against


def test_rudder_against_gusts_adds_no_evidence():
    boat = Boat()
    for block in range(300):
        rudder_rad = radians(5.0) + 0.4 * math.sin(block / 5.0)
        boat.wind_rad = -rudder_rad
        assert boat.hold(BLOCK_S, rudder_rad, 0.1) is None


@pytest.mark.parametrize(
    ("speed_m_s", "sd_deg", "lost_s", "recovered_s"),
    [
        (0.2, 1.0, 72.0, 20.0),
        (0.2, 3.0, 92.0, 30.0),
        (0.4, 1.0, 42.0, 12.0),
        (0.4, 3.0, 52.0, 18.0),
        (0.9, 1.0, 26.0, 8.0),
        (0.9, 6.0, 38.0, 14.0),
    ],
)
def test_detection_time_depends_on_speed_and_heading_uncertainty(speed_m_s, sd_deg, lost_s, recovered_s):
    boat = Boat(speed_m_s=speed_m_s, sd_rad=radians(sd_deg))
    assert boat.hold(400.0, radians(5.0), 0.0) is None
    boat.turn_ratio = 0.0
    lost = boat.hold(200.0, radians(-25.0), -1.0)
    boat.turn_ratio = 1.0
    assert (lost, boat.hold(200.0, radians(30.0), 1.0)) == (lost_s, recovered_s)


@pytest.mark.parametrize(("diffusion_deg2_s", "is_reported"), [(0.1, True), (6.0, False)])
def test_missing_turn_with_a_large_diffusion_is_weaker_evidence(diffusion_deg2_s, is_reported):
    boat = Boat()
    boat.diffusion_rad2_s = radians(1.0) ** 2 * diffusion_deg2_s
    boat.hold(400.0, radians(5.0), 0.0)
    boat.turn_ratio = 0.0
    assert (boat.hold(30.0, radians(-25.0), -1.0) is not None) is is_reported


def test_mean_speed_has_a_memory_of_200_s():
    boat = Boat()
    for block in range(100):
        boat.speed_m_s = 0.4 if block % 2 else 0.8
        boat.block(0.0, 0.0)
    assert boat.state.speed_m_s == pytest.approx(0.6)
    boat.speed_m_s = 1.6
    for _ in range(100):
        boat.block(0.0, 0.0)
    assert boat.state.speed_m_s == pytest.approx(1.6 - math.exp(-1.0), abs=0.01)


@pytest.mark.parametrize(("error_deg", "is_reported"), [(9.0, False), (11.0, True), (-11.0, False)])
def test_only_a_rudder_that_reduces_a_large_error_adds_evidence(error_deg, is_reported):
    boat = Boat()
    boat.hold(120.0, radians(5.0), 0.0)
    boat.turn_ratio = 0.0
    assert (boat.hold(120.0, radians(30.0), radians(error_deg)) is not None) is is_reported


def test_power_of_the_disturbance_is_learned_in_half_an_hour():
    rng, disturbance_rad, boat, decay = random.Random(3), 0.0, Boat(), math.exp(-BLOCK_S / CORRELATION_S)
    for _ in range(1800):
        disturbance_rad = decay * disturbance_rad + math.sqrt(1.0 - decay * decay) * radians(rng.gauss(0.0, 5.0))
        boat.wind_rad = disturbance_rad - 0.09
        boat.block(-boat.wind_rad, 0.0)
    assert math.degrees(math.sqrt(boat.state.disturbance_power_rad2)) == pytest.approx(4.5, rel=0.1)
    assert boat.state.boats[0].mean_rad == pytest.approx(-0.09, abs=0.02)
    calm = Boat(wind_rad=0.0)
    calm.hold(1800.0, 0.0, 0.0)
    assert math.degrees(math.sqrt(calm.state.disturbance_power_rad2)) == pytest.approx(1.49, rel=0.02)
    calm.turn_ratio = 0.0
    calm.hold(16.0, radians(20.0), 1.0)
    previous = calm.state.disturbance_power_rad2
    calm.hold(16.0, radians(20.0), 1.0)
    assert calm.state.disturbance_power_rad2 == previous


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_evidence_is_the_likelihood_ratio_of_all_headings(seed):
    """Compared with the ratio from the covariance of all headings, for the smallest nominal response and for none."""
    boat, rng, turned_rad, count = Boat(turn_ratio=0.0, wind_rad=0.0, sd_rad=radians(6.0)), random.Random(seed), [], 12
    for _ in range(count):
        turned_rad.append(boat.block(radians(25.0), math.nan, noise_rad=rng.gauss(0.0, radians(0.1))))
        assert boat.state.boats[0].evidence > 0.0
    decay = decay_over(BLOCK_S, boat.ship.turning_lag_s) ** np.arange(count)
    decayed = 1.0 - decay_over(BLOCK_S, boat.ship.turning_lag_s)
    rudder_rad = radians(25.0) * (1.0 - decay * decayed * boat.ship.turning_lag_s / BLOCK_S)
    turn_per_rudder, cumulative = boat.ship.turning_ability_1_s * BLOCK_S, np.tril(np.ones((count, count)))
    lag_blocks = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    disturbance_covariance = INITIAL_DISTURBANCE_RAD**2 * np.exp(
        -BLOCK_S * lag_blocks / CORRELATION_S
    ) + MIN_GUST_RAD2_S / BLOCK_S * np.eye(count)
    noise_covariance = (NOISE_SHARE * boat.sd_rad) ** 2 * (np.eye(count) + np.ones((count, count)))
    inverse = np.linalg.inv(turn_per_rudder**2 * cumulative @ disturbance_covariance @ cumulative.T + noise_covariance)
    heading_rad = cumulative @ turned_rad
    residual_rad = heading_rad - RESPONSES[0].min_turn_ratio * turn_per_rudder * cumulative @ rudder_rad
    ratio = 0.5 * (residual_rad @ inverse @ residual_rad - heading_rad @ inverse @ heading_rad)
    assert boat.state.boats[0].evidence == pytest.approx(ratio)


def test_gap_keeps_verdict_and_learned_values():
    boat = Boat(turn_ratio=0.0)
    boat.hold(120.0, radians(5.0), 0.0)
    boat.hold(20.0, radians(-25.0), -1.0)
    state = restart_after_gap(boat.state)
    assert all(boat_before.evidence > 0.0 for boat_before in boat.state.boats[:4])
    assert {
        (boat_after.evidence, boat_after.heading_deficit_rad, boat_after.residual_rad) for boat_after in state.boats
    } == {(0.0, 0.0, 0.0)}
    assert [boat_after.mean_rad for boat_after in state.boats] == [
        boat_before.mean_rad for boat_before in boat.state.boats
    ]
    assert (state.disturbance_power_rad2, state.speed_m_s) == (boat.state.disturbance_power_rad2, boat.state.speed_m_s)
    assert boat.hold(120.0, radians(-25.0), -1.0) is not None
    assert restart_after_gap(boat.state).lost


def test_loss_is_constant_while_the_wind_turns_the_boat():
    """The disturbance varies as in the weak sea, for ten times the detection time."""
    boat = Boat(speed_m_s=0.2)
    assert boat.hold(400.0, radians(5.0), 0.0) is None
    boat.turn_ratio = 0.0
    assert boat.hold(100.0, radians(-25.0), -1.0) is not None
    rng = random.Random(2)
    for _ in range(500):
        boat.wind_rad += 0.02 * (-0.09 - boat.wind_rad) + 0.2 * radians(rng.gauss(0.0, 2.0))
        boat.block(radians(-25.0), -1.0)
        assert boat.state.lost


@pytest.mark.parametrize("speed_m_s", [0.2, 0.9])
def test_wind_of_half_a_rudder_hides_a_loss_and_half_of_that_does_not(speed_m_s):
    """This is the limit of any test, because the headings are the same."""
    rudder_rad = radians(28.0)
    half, lost = Boat(turn_ratio=0.5, speed_m_s=speed_m_s), Boat(turn_ratio=0.0, speed_m_s=speed_m_s)
    half.wind_rad, lost.wind_rad = -0.25 * rudder_rad, 0.25 * rudder_rad
    for _ in range(300):
        assert half.block(rudder_rad, 1.0) == pytest.approx(lost.block(rudder_rad, 1.0))
        assert not half.state.lost
        assert not lost.state.lost
    lost = Boat(turn_ratio=0.0, speed_m_s=speed_m_s, wind_rad=0.125 * rudder_rad)
    assert lost.hold(120.0, rudder_rad, 1.0) is not None


@pytest.mark.parametrize("reason", [INTERRUPTED, LOST, RECOVERED])
def test_restart_keeps_each_filter_with_its_own_response(reason):
    """After a loss all begin at the nominal boat without a rudder, after a recovery at their own with a rudder."""
    boats = tuple(
        ResponseState(0.01 * n, 0.1 + n, 0.2 + 2.0 * n, 0.3 * n, 0.4 + 3.0 * n, 0.5 + 5.0 * n, 6.0) for n in range(16)
    )
    turn_ratios = [1.0] * 8 + [0.5] * 4 + [-1.0] * 4
    for n, boat in enumerate(restart_all(boats, reason)):
        residual_rad, disturbance_rad = 0.0, 0.2 + 2.0 * n
        if reason == LOST:
            residual_rad, disturbance_rad = 0.5, -0.3
        if reason == RECOVERED:
            residual_rad = 0.1 + n - turn_ratios[n] * (0.4 + 3.0 * n)
            disturbance_rad += turn_ratios[n] * (0.5 + 5.0 * n)
        assert boat == pytest.approx((0.01 * n, residual_rad, disturbance_rad, 0.3 * n, 0.0, 0.0, 0.0))
