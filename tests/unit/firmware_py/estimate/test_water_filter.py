"""The water filter: speed, leeway and current from positions; turns, gaps, outliers, hostile input."""

import math

import numpy as np
import pytest

from firmware_py.estimate.water_filter import WaterFilter, begin, correct, take_heading, water_of

SQUARE = tuple(math.radians(angle) for angle in (0.0, 90.0, 180.0, 270.0))


def begun(speed_m_s: float = 0.4, north_m: float = 0.0, east_m: float = 0.0) -> WaterFilter:
    return begin(0.0, north_m, east_m, speed_m_s, 0.3, 0.0, 0.0, 0.3, 0.0, 0.1)


class Boat:
    """A boat that sails through a current, with a filter that takes noisy positions of it."""

    def __init__(self, state, speed_m_s, current_m_s, leeway_rad=0.0, seed=1, speed_sd_m_s=0.05, noise_m=0.3):
        self.state, self.speed_m_s, self.current_m_s, self.leeway_rad = state, speed_m_s, current_m_s, leeway_rad
        self.numbers, self.speed_sd_m_s, self.noise_m = np.random.default_rng(seed), speed_sd_m_s, noise_m
        self.t_s, self.off_m_s = 0.0, 0.0
        self.place_m = [state.track.north_m, state.track.east_m]

    def sail(self, heading_rad, duration_s, step_s=1.0, fix_s=5.0, heading_known=True, fixes=True, jump_m=0.0):
        since_s, keep = 0.0, math.exp(-step_s / 30.0)
        for _ in range(round(duration_s / step_s)):
            self.off_m_s = keep * self.off_m_s + self.speed_sd_m_s * math.sqrt(1.0 - keep * keep) * float(
                self.numbers.standard_normal()
            )
            way_rad, speed_m_s = heading_rad + self.leeway_rad, max(self.speed_m_s + self.off_m_s, 0.0)
            self.place_m[0] += step_s * (speed_m_s * math.cos(way_rad) + self.current_m_s[0])
            self.place_m[1] += step_s * (speed_m_s * math.sin(way_rad) + self.current_m_s[1])
            self.t_s, since_s = self.t_s + step_s, since_s + step_s
            self.state = take_heading(self.state, heading_rad if heading_known else math.nan, step_s)
            if fixes and since_s >= fix_s - 1e-9:
                since_s = 0.0
                seen = [place + jump_m + self.noise_m * float(self.numbers.standard_normal()) for place in self.place_m]
                self.state = correct(self.state, self.t_s, *seen)

    @property
    def water(self):
        return water_of(self.state, self.t_s)


@pytest.mark.parametrize(
    ("speed_m_s", "current_m_s", "leeway_deg"),
    [(0.05, (0.1, -0.05), 0.0), (0.5, (0.15, -0.15), 25.0), (2.5, (-0.3, 0.2), 0.0), (0.5, (0.0, 0.8), -8.0)],
)
def test_turns_tell_speed_current_and_leeway_apart(speed_m_s, current_m_s, leeway_deg):
    boat = Boat(begun(), speed_m_s, current_m_s, math.radians(leeway_deg), speed_sd_m_s=0.1 * speed_m_s)
    for leg in range(8):
        boat.sail(SQUARE[leg % 4], 600.0)
    water = boat.water
    assert math.dist((water.current_north_m_s, water.current_east_m_s), current_m_s) < 0.03 + 0.01 * speed_m_s
    assert water.current_sd_m_s < 0.05
    forward_m_s = speed_m_s * math.cos(math.radians(leeway_deg))
    assert abs(water.mean_speed_m_s - forward_m_s) < 3.0 * water.mean_speed_sd_m_s < 0.25
    assert abs(water.leeway_rad - math.radians(leeway_deg)) < 3.0 * water.leeway_sd_rad
