"""The disturbances that any sea can be sailed with: one record each, absent by default.

They compose: a hull is built of those that are there (hil/ship/hull.py), and what is absent leaves a
run as it is to the last bit. `hil/ship/extras_table.py` says what each is, reads and prints them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from hil.ship.traffic import SCENES
from hil.ship.waves import DAMPING


def number(unit: str, low: float, high: float, default: float | None = None) -> Any:
    """Return the field of a number of an option; without a default it has to be given."""
    metadata = {"unit": unit, "low": low, "high": high}
    return field(metadata=metadata) if default is None else field(default=default, metadata=metadata)


def word(choices: tuple[str, ...], default: str) -> Any:
    """Return the field of a name of an option, one of several."""
    return field(default=default, metadata={"choices": choices})


@dataclass(frozen=True, slots=True)
class FloatBody:
    """A float that follows the glider: frequency of its own, and the damping ratio."""

    own_frequency_rad_s: float = number("rad/s", 0.05, 3.0, 0.4)
    damping: float = number("-", 0.05, 3.0, 0.6)


@dataclass(frozen=True, slots=True)
class Leeway:
    """Angles of the way through the water to starboard of the heading: of the body, and by a wind on the beam."""

    body_deg: float = number("deg", -45.0, 45.0, 5.0)
    wind_deg: float = number("deg", 0.0, 45.0, 0.0)
    wind_from_deg: float = number("deg", -360.0, 360.0, 0.0)


@dataclass(frozen=True, slots=True)
class Slide:
    """How much of the sway of the regressions she has in her turns."""

    share: float = number("-", 0.0, 5.0, 1.0)


@dataclass(frozen=True, slots=True)
class Orbital:
    """Orbital motion of a short-crested sea: rms of the velocity vector, spread of the directions, damping."""

    velocity_m_s: float = number("m/s", 0.0, 3.0, 0.4)
    spread_deg: float = number("deg", 0.0, 60.0, 25.0)
    damping: float = number("-", 0.02, 0.65, DAMPING)


@dataclass(frozen=True, slots=True)
class WaveSpeed:
    """Speed by the wave groups, as a share of the mean, and the calm that begins at a time."""

    spread: float = number("-", 0.0, 0.6, 0.25)
    memory_s: float = number("s", 5.0, 3600.0, 90.0)
    calm_at_s: float = number("s", 0.0, 1e7, 0.0)
    calm_for_s: float = number("s", 0.0, 1e7, 0.0)


@dataclass(frozen=True, slots=True)
class Receiver:
    """A receiver as bought: how late it tells, how much of the time it has no fix, and its velocity."""

    latency_s: float = number("s", 0.0, 5.0, 0.5)
    lost: float = number("share", 0.0, 1.0, 0.02)
    gap_s: float = number("s", 1.0, 3600.0, 10.0)
    filter_s: float = number("s", 0.0, 30.0, 1.0)
    noise_m_s: float = number("m/s", 0.0, 1.0, 0.05)


@dataclass(frozen=True, slots=True)
class Compass:
    """A compass as bought: the five coefficients, the rms of its heel error on north, the lag of its damping."""

    a_deg: float = number("deg", -30.0, 30.0, 1.0)
    b_deg: float = number("deg", -30.0, 30.0, 4.0)
    c_deg: float = number("deg", -30.0, 30.0, -3.0)
    d_deg: float = number("deg", -30.0, 30.0, 1.5)
    e_deg: float = number("deg", -30.0, 30.0, 0.5)
    heel_deg: float = number("deg", 0.0, 30.0, 2.0)
    lag_s: float = number("s", 0.0, 10.0, 0.5)


@dataclass(frozen=True, slots=True)
class OtherShip:
    """What the ship's K and T are of those that the boat is told."""

    ability: float = number("-", 0.1, 10.0)
    lag: float = number("-", 0.1, 10.0, 1.0)


@dataclass(frozen=True, slots=True)
class Delay:
    """How long the rudder takes until it turns the boat."""

    delay_s: float = number("s", 0.0, 30.0)


@dataclass(frozen=True, slots=True)
class Supply:
    """Panels, battery and steady load of the boat: peak power, share of clouds, capacity, load, charge at the start."""

    panel_w: float = number("W", 0.0, 5000.0, 60.0)
    clouds: float = number("share", 0.0, 1.0, 0.4)
    battery_wh: float = number("Wh", 1.0, 1e5, 500.0)
    load_w: float = number("W", 0.0, 1000.0, 4.0)
    charge: float = number("share", 0.0, 1.0, 0.8)


@dataclass(frozen=True, slots=True)
class Vessels:
    """Other ships: the scene, the share of what they send that is lost, and how far they are heard."""

    scene: str = word(tuple(SCENES), "crossing")
    lost: float = number("share", 0.0, 1.0, 0.1)
    range_km: float = number("km", 0.1, 200.0, 40.0)


@dataclass(frozen=True, slots=True)
class Yaw:
    """White disturbance of the yaw acceleration: the diffusion of the heading."""

    diffusion_deg2_s: float = number("deg^2/s", 0.0, 50.0, 2.0)


@dataclass(frozen=True, slots=True)
class OwnWaves:
    """Wave yaw with a period of its own, and its damping."""

    period_s: float = number("s", 0.5, 30.0, 2.5)
    damping: float = number("-", 0.02, 0.65, 0.18)


@dataclass(frozen=True, slots=True)
class Bias:
    """Standard deviation and memory of the rudder bias."""

    sd_deg: float = number("deg", 0.0, 20.0, 10.0)
    memory_s: float = number("s", 10.0, 36000.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Extras:
    """What a sea is sailed with; None is without."""

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


NONE = Extras()
