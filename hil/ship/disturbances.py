"""Disturbances that can be added to any scenario: one record for each, absent by default.

The hull (hil/ship/hull.py) is built from those that are present; an absent one leaves a run unchanged to the last
bit. `hil/ship/disturbance_options.py` describes, reads and prints them. The fields of a record are the keys that a
campaign draws.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from hil.ship.traffic import PATTERNS
from hil.ship.waves import DAMPING


def number_field(unit: str, low: float, high: float, default: float | None = None) -> Any:
    """Return a dataclass field for a number of an option; a number without default is required."""
    metadata = {"unit": unit, "low": low, "high": high}
    return field(metadata=metadata) if default is None else field(default=default, metadata=metadata)


def choice_field(choices: tuple[str, ...], default: str) -> Any:
    """Return a dataclass field for a name that is one of several choices."""
    return field(default=default, metadata={"choices": choices})


@dataclass(frozen=True, slots=True)
class FloatBody:
    """A float that follows the glider: natural frequency and damping ratio."""

    own_frequency_rad_s: float = number_field("rad/s", 0.05, 3.0, 0.4)
    damping: float = number_field("-", 0.05, 3.0, 0.6)


@dataclass(frozen=True, slots=True)
class Leeway:
    """Leeway: constant angle, positive to starboard; angle away from a wind on the beam; direction of the wind."""

    body_deg: float = number_field("deg", -45.0, 45.0, 5.0)
    wind_deg: float = number_field("deg", 0.0, 45.0, 0.0)
    wind_from_deg: float = number_field("deg", -360.0, 360.0, 0.0)


@dataclass(frozen=True, slots=True)
class Slide:
    """Sway in turns, as a share of the sway that the regressions give."""

    share: float = number_field("-", 0.0, 5.0, 1.0)


@dataclass(frozen=True, slots=True)
class Orbital:
    """Orbital motion of a short-crested sea: rms of the velocity vector, spread of the directions, damping."""

    velocity_m_s: float = number_field("m/s", 0.0, 3.0, 0.4)
    spread_deg: float = number_field("deg", 0.0, 60.0, 25.0)
    damping: float = number_field("-", 0.02, 0.65, DAMPING)


@dataclass(frozen=True, slots=True)
class WaveSpeed:
    """Variation of the speed: standard deviation as a share of the mean, time constant; start, duration of a calm."""

    spread: float = number_field("-", 0.0, 0.6, 0.25)
    memory_s: float = number_field("s", 5.0, 3600.0, 90.0)
    calm_at_s: float = number_field("s", 0.0, 1e7, 0.0)
    calm_for_s: float = number_field("s", 0.0, 1e7, 0.0)


@dataclass(frozen=True, slots=True)
class Receiver:
    """A GNSS receiver: latency, share of time without a fix, mean gap, time constant and noise of the velocity."""

    latency_s: float = number_field("s", 0.0, 5.0, 0.5)
    lost: float = number_field("share", 0.0, 1.0, 0.02)
    gap_s: float = number_field("s", 1.0, 3600.0, 10.0)
    filter_s: float = number_field("s", 0.0, 30.0, 1.0)
    noise_m_s: float = number_field("m/s", 0.0, 1.0, 0.05)


@dataclass(frozen=True, slots=True)
class Compass:
    """An uncorrected compass: five deviation coefficients, rms heel error on north, damping lag."""

    a_deg: float = number_field("deg", -30.0, 30.0, 1.0)
    b_deg: float = number_field("deg", -30.0, 30.0, 4.0)
    c_deg: float = number_field("deg", -30.0, 30.0, -3.0)
    d_deg: float = number_field("deg", -30.0, 30.0, 1.5)
    e_deg: float = number_field("deg", -30.0, 30.0, 0.5)
    heel_deg: float = number_field("deg", 0.0, 30.0, 2.0)
    lag_s: float = number_field("s", 0.0, 10.0, 0.5)


@dataclass(frozen=True, slots=True)
class OtherShip:
    """Model mismatch: ratios of the ship's K and T to those in the vehicle file."""

    ability: float = number_field("-", 0.1, 10.0)
    lag: float = number_field("-", 0.1, 10.0, 1.0)


@dataclass(frozen=True, slots=True)
class Delay:
    """Delay from the rudder angle to the yaw response."""

    delay_s: float = number_field("s", 0.0, 30.0)


@dataclass(frozen=True, slots=True)
class Supply:
    """Panels, battery and steady load: peak power, share of clouds, capacity, load, state of charge at the start."""

    panel_w: float = number_field("W", 0.0, 5000.0, 60.0)
    clouds: float = number_field("share", 0.0, 1.0, 0.4)
    battery_wh: float = number_field("Wh", 1.0, 1e5, 500.0)
    load_w: float = number_field("W", 0.0, 1000.0, 4.0)
    charge: float = number_field("share", 0.0, 1.0, 0.8)


@dataclass(frozen=True, slots=True)
class Vessels:
    """Other ships: the traffic pattern, the share of AIS messages that is lost, and the reception range."""

    scene: str = choice_field(tuple(PATTERNS), "crossing")
    lost: float = number_field("share", 0.0, 1.0, 0.1)
    range_km: float = number_field("km", 0.1, 200.0, 40.0)


@dataclass(frozen=True, slots=True)
class Yaw:
    """White noise of the yaw acceleration, given as the diffusion of the heading."""

    diffusion_deg2_s: float = number_field("deg^2/s", 0.0, 50.0, 2.0)


@dataclass(frozen=True, slots=True)
class OwnWaves:
    """Wave yaw with another period than the waves that move the receiver, and its damping."""

    period_s: float = number_field("s", 0.5, 30.0, 2.5)
    damping: float = number_field("-", 0.02, 0.65, 0.18)


@dataclass(frozen=True, slots=True)
class Bias:
    """Standard deviation and time constant of the rudder bias."""

    sd_deg: float = number_field("deg", 0.0, 20.0, 10.0)
    memory_s: float = number_field("s", 10.0, 36000.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Wind:
    """Wind that the boat measures: mean speed, direction, standard deviation of the wind as a share of the speed."""

    speed_m_s: float = number_field("m/s", 0.0, 80.0, 8.0)
    from_deg: float = number_field("deg", -360.0, 360.0, 270.0)
    turbulence: float = number_field("share", 0.0, 0.6, 0.12)


@dataclass(frozen=True, slots=True)
class Depth:
    """Water depth at the start, and its decrease per metre to the north."""

    start_m: float = number_field("m", 0.5, 12000.0, 50.0)
    slope: float = number_field("-", -1.0, 1.0, 0.0)


@dataclass(frozen=True, slots=True)
class Disturbances:
    """The disturbances of a scenario; None where absent."""

    float_body: FloatBody | None = None
    leeway: Leeway | None = None
    slide: Slide | None = None
    orbital: Orbital | None = None
    wave_speed: WaveSpeed | None = None
    receiver: Receiver | None = None
    compass: Compass | None = None
    other_ship: OtherShip | None = None
    delay: Delay | None = None
    supply: Supply | None = None
    vessels: Vessels | None = None
    yaw: Yaw | None = None
    own_waves: OwnWaves | None = None
    bias: Bias | None = None
    wind: Wind | None = None
    depth: Depth | None = None


NO_DISTURBANCES = Disturbances()
