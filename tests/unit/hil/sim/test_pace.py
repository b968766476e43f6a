"""Pacing with a simulated wall clock."""

import math

import pytest

from hil.sim import pace
from hil.sim.pace import Pacer


class Clock:
    def __init__(self):
        self.now_s = 100.0

    def monotonic(self):
        return self.now_s

    def sleep(self, seconds):
        self.now_s += seconds * 1.25  # too long


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(pace, "time", clock)
    return clock


def test_pacer_keeps_its_speed_without_drift_after_a_change(clock):
    pacer = Pacer(math.inf)
    pacer.wait(0.0)
    pacer.wait(1e6)
    assert clock.now_s == 100.0
    pacer.set_speed(20.0)
    for step in range(1001):
        pacer.wait(1e6 + step * 0.1)
    assert clock.now_s == pytest.approx(105.0, abs=0.002)


def test_late_call_does_not_sleep(clock):
    pacer = Pacer(1.0)
    pacer.wait(0.0)
    clock.now_s += 10.0
    pacer.wait(1.0)
    assert clock.now_s == 110.0
