"""What the estimator has learned of boat and sea, as named values; None while it is not known."""

from __future__ import annotations

from firmware_py.angles import degrees
from firmware_py.link.scene import Scene
from firmware_py.records import Estimate, Water


def _learned(scene: Scene) -> Estimate | None:
    return scene.snapshot.estimate


def _water(scene: Scene) -> Water | None:
    return scene.snapshot.water


def heading_sd_deg(scene: Scene) -> float | None:
    """Return the standard deviation of the heading without waves, in degrees."""
    learned = _learned(scene)
    return None if learned is None else degrees(learned.heading_sd_rad)


def innovation_deg(scene: Scene) -> float | None:
    """Return what the last heading differed from the expected one, in degrees."""
    learned = _learned(scene)
    return None if learned is None else degrees(learned.innovation_rad)


def innovation_square(scene: Scene) -> float | None:
    """Return the average normalised innovation squared: 1 for an honest filter."""
    learned = _learned(scene)
    return None if learned is None else learned.innovation_square


def heading_source(scene: Scene) -> float | None:
    """Return what the heading is taken from: compass A 0, compass B 1, course over ground 2, nothing 3."""
    learned = _learned(scene)
    return None if learned is None else float(learned.source)


def trim_deg(scene: Scene) -> float | None:
    """Return the rudder angle at which she runs straight, in degrees."""
    learned = _learned(scene)
    return None if learned is None else degrees(learned.bias_rad)


def wave_sd_deg(scene: Scene) -> float | None:
    """Return the standard deviation of the yaw of the waves, in degrees."""
    learned = _learned(scene)
    return None if learned is None else degrees(learned.wave_sd_rad)


def wave_period_s(scene: Scene) -> float | None:
    """Return the peak period of the yaw of the waves, in seconds."""
    learned = _learned(scene)
    return None if learned is None else learned.wave_period_s


def turning_factor(scene: Scene) -> float | None:
    """Return by what she turns better than her model says."""
    learned = _learned(scene)
    return None if learned is None else learned.turning_factor


def water_speed_m_s(scene: Scene) -> float | None:
    """Return the speed through the water, in m/s."""
    water = _water(scene)
    return None if water is None else water.speed_m_s


def current_north_m_s(scene: Scene) -> float | None:
    """Return the current's northward part, in m/s."""
    water = _water(scene)
    return None if water is None else water.current_north_m_s


def current_east_m_s(scene: Scene) -> float | None:
    """Return the current's eastward part, in m/s."""
    water = _water(scene)
    return None if water is None else water.current_east_m_s


def current_sd_m_s(scene: Scene) -> float | None:
    """Return the standard deviation of the current in the worse known direction, in m/s."""
    water = _water(scene)
    return None if water is None else water.current_sd_m_s
