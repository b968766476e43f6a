"""The seas that a run can be made in: one row each."""

from __future__ import annotations

from dataclasses import dataclass


class UnknownScenarioError(ValueError):
    """A scenario name that is not in the table; the text lists those that are."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """One sea; in degrees, because rows are read by people and printed in reports.

    `speed_m_s` is the ship's speed through the water, `bias_deg` the rudder angle at which
    the boat runs straight, `drift_deg` the spread of its wandering (Gauss-Markov, 100 s).
    `current_toward_deg` is where the current sets, at the start when there is a tide: `tide_s` is
    its period (0: none) and `tide_rotary` how it turns (hil/ship/tide.py). `gust_deg` is the
    strength of gusts, as a rudder angle (hil/ship/gusts.py), `orbital_m_s` how fast the waves carry
    the receiver to and fro (standard deviation), toward `waves_toward_deg` (hil/ship/orbit.py).
    """

    name: str
    text: str
    speed_m_s: float
    wave_period_s: float
    wave_yaw_deg: float
    bias_deg: float
    drift_deg: float
    current_m_s: float
    current_toward_deg: float = 90.0
    tide_s: float = 0.0
    tide_rotary: float = 0.0
    gust_deg: float = 0.0
    orbital_m_s: float = 0.0
    waves_toward_deg: float = 40.0


TABLE: tuple[Scenario, ...] = (
    Scenario("calm", "flat water, no disturbance", 0.4, 0.0, 0.0, 0.0, 0.0, 0.0),
    Scenario("tank", "the paper's tank: waves 0.23 m high, 10 m long", 0.4, 2.53, 1.5, 0.0, 0.0, 0.0),
    Scenario("sea", "the paper's sea trial: moderate waves and a cross current", 0.9, 6.0, 4.0, 5.0, 2.0, 0.3),
    Scenario("swell", "long swell that swings her by 20 deg", 0.7, 8.0, 20.0, 5.0, 2.0, 0.0),
    Scenario("weak", "hardly any wave power: slow and sluggish", 0.2, 4.0, 10.0, 3.0, 2.0, 0.0),
    Scenario("storm", "30 deg of wave yaw, a current faster than she is", 0.5, 7.0, 30.0, 8.0, 4.0, 0.6),
    Scenario(
        "mission",
        "a mission area: a stream that turns round every 2 h",
        0.5,
        6.0,
        6.0,
        3.0,
        2.0,
        0.25,
        60.0,
        7200.0,
        0.5,
    ),
    Scenario("gusts", "a short sea and gusts on the beam", 0.6, 4.0, 6.0, 4.0, 2.0, 0.2, gust_deg=10.0),
    Scenario(
        "surge", "the swell, its waves carry the receiver to and fro", 0.7, 8.0, 20.0, 5.0, 2.0, 0.0, orbital_m_s=0.4
    ),
)


def named(name: str) -> Scenario:
    """Return the row of a name, or raise UnknownScenarioError."""
    for row in TABLE:
        if row.name == name:
            return row
    raise UnknownScenarioError(f"no scenario {name!r}; there are: {', '.join(row.name for row in TABLE)}")
