"""Each part of the twin against the firmware's, and its ship against the harness's, to the last bit."""

import math

import numpy as np
import pytest

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.estimate import kalman, learning, over_ground, wave_filter, wave_filter_state
from firmware_py.model.kt import OCEAN_RAMBLER
from hil.lab.twin import devices, sailing
from hil.lab.twin import kalman as twin_kalman
from hil.lab.twin import learning as twin_learning
from hil.lab.twin import over_ground as twin_over_ground
from hil.lab.twin import ship as ships
from hil.lab.twin import wave_filter as twin_filter
from hil.lab.twin import wave_filter_state as twin_state
from hil.lab.twin.sea import sea_of as drawn
from hil.ship.hull import GRID_S, Hull
from hil.ship.scenarios import TABLE, sea_of

pytestmark = pytest.mark.timeout(600)  # parts are compiled first

PARAMETERS = ParameterSet()
SHARED = {
    twin_kalman: (kalman,),
    twin_learning: (learning,),
    twin_filter: (wave_filter, wave_filter_state, over_ground),
    twin_state: (wave_filter, wave_filter_state),
    twin_over_ground: (wave_filter, over_ground),
}
OTHERS = {"FIRST", "T", "STATES", "HEADING", "COURSE"}  # of the twin alone, or of another kind


@pytest.mark.parametrize("twin", SHARED, ids=lambda twin: twin.__name__.rpartition(".")[2])
def test_every_constant_is_the_firmware_s(twin):
    compared = 0
    for name, value in vars(twin).items():
        if not name.isupper() or name in OTHERS or not isinstance(value, float | int | np.ndarray):
            continue
        for original in SHARED[twin]:
            if isinstance(theirs := getattr(original, name, None), float | int | tuple):
                assert np.array_equal(value, theirs), name
                compared += 1
    assert compared >= (2 if twin is twin_state else 4)


def test_the_filter_s_first_numbers_are_the_firmware_s():
    assert np.array_equal(twin_state.FIRST, wave_filter_state.FIRST)
    model, first = learning.NoiseModel(), twin_learning.FIRST
    assert model.log_power == first[twin_learning.LOG_POWER]
    assert model.log_slow_share == first[twin_learning.LOG_SHARE]


def test_a_covariance_is_predicted_as_the_firmware_does():
    numbers = np.random.default_rng(5)
    for _ in range(20):
        half = numbers.normal(size=(18, 18))
        columns = np.concatenate((half @ half.T, numbers.normal(size=(18, 2))), axis=1)
        columns[:, :18] = 0.5 * (columns[:, :18] + columns[:, :18].T)
        turned, follow, wave = (tuple(numbers.normal(size=size).tolist()) for size in (8, 4, 4))
        noise, motions = numbers.random(18).tolist(), [tuple(row) for row in numbers.random((3, 3)).tolist()]
        for k, (angle, _, rate) in enumerate(motions):
            noise[12 + 2 * k], noise[13 + 2 * k] = angle, rate
        transition = kalman.Transition(kalman.Turn(*turned), follow, wave, 0.9)
        expected = kalman.predict(columns, transition, noise[:12], motions)
        ours = sailing.zeros(twin_kalman.COVARIANCE)
        ours["p"], ours["noise"], ours["both"] = columns, noise, [both for _, both, _ in motions]
        twin_kalman.predict(ours, turned, follow, wave, 0.9)
        assert np.array_equal(ours["p"], expected)


@pytest.mark.parametrize("size", [1.0, 1e-160])  # of which the square is hardly a number
def test_a_measurement_is_taken_in_as_the_firmware_does(size):
    numbers = np.random.default_rng(6)
    for _ in range(20):
        half, x, shown = size * numbers.normal(size=(18, 18)), numbers.normal(size=18), size * numbers.normal(size=20)
        p, slopes, variance = half @ half.T, numbers.normal(size=(18, 2)), 3.0 + float(numbers.random())
        columns = np.concatenate((0.5 * (p + p.T), slopes), axis=1)
        moved, expected = kalman.correct(tuple(x.tolist()), columns, kalman.Measured(shown, variance), 0.3, variance)
        ours = sailing.zeros(twin_kalman.COVARIANCE)
        ours["p"], ours["shown"], ours["innovation"], ours["variance"] = columns, shown, 0.3, variance
        twin_kalman.correct(x, ours)
        assert np.array_equal(ours["p"], expected)
        assert tuple(x) == moved


def test_a_turn_is_taken_from_the_waves_as_the_firmware_does():
    """The compass circles against the rudder; that the estimate would go astray is its own test."""
    model, numbers = np.array(sailing.boat_of(PARAMETERS).model), np.random.default_rng(4)
    known, theirs = wave_filter_state.WaveFilterSettings.of(PARAMETERS), wave_filter_state.WaveFilterState()
    ours, covariance, given_back = sailing.zeros(twin_state.FILTER), sailing.zeros(twin_kalman.COVARIANCE), 0
    ours["w"][twin_state.WATER_SPEED] = 0.5
    twin_state.forget(ours)
    for tick in range(1500):
        t_s, rudder_rad = 0.1 * tick, radians(30.0) if tick > 300 else 0.0
        heading_rad = math.remainder(0.2 * math.sin(t_s) - 0.005 * max(tick - 300, 0), math.tau)
        heading_rad += 0.005 * float(numbers.standard_normal())
        before_rad = theirs.slow_wave_rad
        theirs = wave_filter.update(known, theirs, [wave_filter.Heading(t_s, heading_rad)], [], rudder_rad)
        twin_filter.correct_heading(ours, covariance, model, t_s, heading_rad)
        ours["w"][twin_state.RUDDER] = rudder_rad
        assert tuple(ours["x"]) == theirs.x
        assert ours["w"][twin_state.SLOW_WAVE] == theirs.slow_wave_rad
        given_back += theirs.slow_wave_rad == 0.0 != before_rad
    assert np.array_equal(covariance["p"][:, :18].ravel(), np.frombuffer(theirs.p))
    assert given_back > 0


KINDER = "float=0.4:1.2,leeway=6:3:80,sway=0.5,orbital=0.3,speed=0.5:30:8:6,compass=2:3:1:1:1:4:0,kt=0.7:1.3,delay=0.33"
NOISE = "yaw=4,bias=12:600"


@pytest.mark.parametrize(
    "text", [*(row.name for row in TABLE), "tank+orbital=0.2,compass", f"mission+{KINDER},{NOISE}", "calm+sway,compass"]
)
def test_the_ship_in_her_sea_is_the_harness_s(text):
    scenario, seconds = sea_of(text), 20.0
    hull, sea = Hull(scenario, OCEAN_RAMBLER, 3), drawn(scenario, 3, seconds)
    state, waiting, ship = (
        np.zeros(ships.HULL_STATES),
        np.zeros(max(sea.ship.delay_steps, 1)),
        sailing.record_of(sea.ship),
    )
    ships.begin_hull(state, ship)
    numbers = np.random.default_rng(1)
    rudder = 0.0
    for step in range(int(seconds / GRID_S)):
        offset_s = float(numbers.uniform(0.0, GRID_S))
        ours = ships.shown_heading(state, ship, sea.series, step, offset_s)
        assert ours == hull.shown_heading_rad(offset_s)
        assert ships.velocity(state, ship, sea.series, step, offset_s) == hull.velocity_in_waves_m_s(offset_s)
        assert ships.position(state, ship, sea.series, step, offset_s) == hull.position_in_waves_m(offset_s)
        rudder = min(max(rudder + float(numbers.normal(0.0, 0.02)), -0.5), 0.5)
        hull.step(rudder)
        in_water = ships.rudder_in_water(ship, waiting, step, rudder)
        ships.turn_hull(state, ship, sea.series, step, in_water)
        assert state[ships.PSI] == hull.glider_heading_rad(0.0)


def test_a_ship_that_is_none_is_refused():
    with pytest.raises(ValueError, match="not a ship"):
        drawn(sea_of("tank"), 1, 10.0, OCEAN_RAMBLER._replace(turning_lag_s=-1.0))


def test_a_bearing_is_printed_as_a_device_prints_it():
    assert devices.bearing(359.97, 0.1) == 0.0
    assert devices.bearing(-0.26, 0.1) == pytest.approx(359.7)
    assert [devices.digits_of(number) for number in (0.0, 9.9, 10.0, 359.9)] == [1, 1, 2, 3]
