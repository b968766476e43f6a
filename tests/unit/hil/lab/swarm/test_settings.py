"""Limits of the settings of the fish swarm."""

import math

import pytest

from hil.lab.swarm import SettingsError, SwarmSettings


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("fish", 1),
        ("fish", 10_001),
        ("fish", 2.5),
        ("fish", True),
        ("iterations", 0),
        ("tries", 0),
        ("seed", -1),
        ("vision", 0.0),
        ("vision", 1.5),
        ("vision", math.nan),
        ("step", -0.1),
        ("step", math.inf),
        ("congestion", -0.1),
        ("congestion", 1.1),
        ("shrink", 0.0),
        ("shrink", 2.0),
        ("strategy", "best"),
        ("prey", ""),
        ("max_evaluations", 1),
    ],
)
def test_value_out_of_range_is_refused_with_its_remedy(name, value):
    with pytest.raises(SettingsError, match=f"{name} .*: give "):
        SwarmSettings(**{name: value})


def test_limits_of_the_ranges_are_allowed():
    SwarmSettings(fish=2, iterations=1, tries=1, vision=1.0, step=1.0, congestion=0.0, shrink=1.0, seed=2**64 - 1)
    SwarmSettings(fish=30, congestion=1.0, max_evaluations=30)


def test_equal_settings_are_equal_and_hashable():
    assert SwarmSettings() == SwarmSettings()
    assert hash(SwarmSettings(seed=2)) == hash(SwarmSettings(seed=2))
