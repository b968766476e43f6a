"""Pacing with a simulated wall clock."""

import math

import pytest

from hil.sim import pace
from hil.sim.pace import Pacer


class Wall:
    def __init__(self):
        self.now_s = 100.0

    def monotonic(self):
        return self.now_s

    def sleep(self, seconds):
        self.now_s += seconds * 1.25  # a sleep is never exact


@pytest.fixture
def wall(monkeypatch):
    wall = Wall()
    monkeypatch.setattr(pace, "time", wall)
    return wall


def test_a_run_keeps_its_speed_without_drift(wall):
    pacer = Pacer(20.0)
    for step in range(1001):
        pacer.wait(step * 0.1)
    assert wall.now_s == pytest.approx(105.0, abs=0.002)


def test_a_new_speed_applies_from_the_next_call(wall):
    pacer = Pacer(math.inf)
    pacer.wait(1e6)
    pacer.set_speed(20.0)
    pacer.wait(1e6 + 1.0)
    assert wall.now_s == 100.0
    for step in range(1, 1001):
        pacer.wait(1e6 + 1.0 + step * 0.1)
    assert wall.now_s == pytest.approx(105.0, abs=0.002)


def test_infinite_speed_never_sleeps(wall):
    pacer = Pacer(math.inf)
    pacer.wait(0.0)
    pacer.wait(1e6)
    assert wall.now_s == 100.0


def test_a_late_run_does_not_sleep(wall):
    pacer = Pacer(1.0)
    pacer.wait(0.0)
    wall.now_s += 10.0
    pacer.wait(1.0)
    assert wall.now_s == 110.0
