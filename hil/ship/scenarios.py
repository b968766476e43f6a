"""Table of the scenarios of simulated runs; "the paper" is Wang et al. 2018."""

from __future__ import annotations

from dataclasses import dataclass, replace

from hil.ship import disturbance_options
from hil.ship.disturbances import NO_DISTURBANCES, Disturbances


class UnknownScenarioError(ValueError):
    """A scenario name is not in the table; the text lists the valid names."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """One scenario. Angles are in degrees, because the rows are edited by hand and printed in reports.

    `speed_m_s` is the speed through the water, `wave_period_s` the period of the spectral peak (0: no waves),
    `wave_yaw_deg` the standard deviation of the wave yaw, `bias_deg` the mean rudder bias and `drift_deg` the standard
    deviation of its variation (Gauss-Markov, 100 s). `current_toward_deg` is the direction that the current flows to
    (at the start, if there is a tide); `tide_s` is the period of the tide (0: none) and `tide_rotary` the ratio of the
    axes of its ellipse (hil/ship/planar.py).
    `gust_deg` is the rms of the peaks of the gusts, as a rudder angle (hil/ship/gusts.py). `orbital_m_s` is the
    standard deviation of the wave orbital velocity, toward `waves_toward_deg` (hil/ship/orbit.py). `disturbances` are
    the optional disturbances (hil/ship/disturbance_options.py).
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
    disturbances: Disturbances = NO_DISTURBANCES


TABLE: tuple[Scenario, ...] = (
    Scenario("calm", "flat water, no disturbance", 0.4, 0.0, 0.0, 0.0, 0.0, 0.0),
    Scenario("tank", "the paper's tank: waves 0.23 m high, 10 m long", 0.4, 2.53, 1.5, 0.0, 0.0, 0.0),
    Scenario("sea", "the paper's sea trial: moderate waves and a cross current", 0.9, 6.0, 4.0, 5.0, 2.0, 0.3),
    Scenario("swell", "long swell with 20 deg of wave yaw", 0.7, 8.0, 20.0, 5.0, 2.0, 0.0),
    Scenario("weak", "low wave power: a slow boat with little rudder effect", 0.2, 4.0, 10.0, 3.0, 2.0, 0.0),
    Scenario("storm", "30 deg of wave yaw, a current faster than the boat", 0.5, 7.0, 30.0, 8.0, 4.0, 0.6),
    Scenario(
        "mission",
        "a mission area: a current that turns with a period of 2 h",
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
    Scenario("gusts", "a short sea with gusts on the beam", 0.6, 4.0, 6.0, 4.0, 2.0, 0.2, gust_deg=10.0),
    Scenario(
        "surge", "the swell, with wave orbital motion of the receiver", 0.7, 8.0, 20.0, 5.0, 2.0, 0.0, orbital_m_s=0.4
    ),
    # These voyages of docs/explanation/capabilities.md combine several disturbances.
    Scenario(
        "ocean-1",
        "a trade wind sea: float on an umbilical, some leeway, a realistic receiver",
        0.6,
        6.0,
        15.0,
        4.0,
        2.0,
        0.15,
        disturbances=disturbance_options.parse("float=0.5:0.6,leeway=3,receiver"),
    ),
    Scenario(
        "ocean-2",
        "the swell with its orbital motion and an uncorrected compass",
        0.7,
        8.0,
        20.0,
        5.0,
        2.0,
        0.0,
        disturbances=disturbance_options.parse("orbital=0.4:12,compass"),
    ),
    Scenario(
        "ocean-3",
        "low wave power, at times none for minutes, and a current as fast as the boat",
        0.2,
        4.0,
        10.0,
        3.0,
        2.0,
        0.2,
        disturbances=disturbance_options.parse("float=0.3:0.6,speed=0.3:120:560:160"),
    ),
    Scenario(
        "ocean-4",
        "a rough sea with most disturbances; the ship turns less than its model predicts",
        0.5,
        8.0,
        20.0,
        6.0,
        3.0,
        0.3,
        gust_deg=5.0,
        disturbances=disturbance_options.parse(
            "float=0.3:0.6,leeway=5:4:300,sway,orbital=0.4:25,speed=0.25:90,receiver=0.8:0.05:15:1.5:0.08,"
            "compass=1:4:-3:1.5:0.5:3:1,kt=0.8:1.3,delay=0.5"
        ),
    ),
    # Seas with disturbances identified from recordings of a 5 m vessel (docs/explanation/physics.md, "Recorded seas").
    Scenario(
        "fjord",
        "as recorded in sheltered water: little diffusion of the heading, a changing rudder bias",
        0.5,
        5.5,
        0.5,
        3.0,
        0.0,
        0.1,
        disturbances=disturbance_options.parse(
            "yaw=0.4,waves=2:0.3,bias=8:900,speed=0.1:30,leeway=5,orbital=0.07:60:0.15,receiver=0.2:0:10:4:0.005"
        ),
    ),
    Scenario(
        "coast",
        "as recorded along a coast: typical diffusion of the heading, leeway, a slow receiver",
        0.5,
        8.0,
        1.1,
        3.0,
        0.0,
        0.15,
        disturbances=disturbance_options.parse(
            "yaw=2,waves=2.5:0.18,bias=10:1500,speed=0.2:30,leeway=-15,orbital=0.14:60:0.15,receiver=0.2:0:10:8:0.005"
        ),
    ),
    Scenario(
        "offshore",
        "as recorded in the open sea: strong diffusion of the heading, much leeway, a very slow receiver",
        0.5,
        8.5,
        2.4,
        3.0,
        0.0,
        0.2,
        disturbances=disturbance_options.parse(
            "yaw=6,waves=3.2:0.25,bias=12:3000,speed=0.3:30,leeway=25,orbital=0.42:60:0.15,receiver=0.2:0:10:12:0.005"
        ),
    ),
)


def find_scenario(name: str) -> Scenario:
    """Return the scenario with this name, or raise UnknownScenarioError."""
    for row in TABLE:
        if row.name == name:
            return row
    raise UnknownScenarioError(f"unknown scenario {name!r}; use one of {', '.join(row.name for row in TABLE)}")


def with_disturbances(scenario: Scenario, text: str) -> Scenario:
    """Return the scenario with disturbances replaced by those of an option text, or raise DisturbanceError."""
    disturbances = disturbance_options.parse(text, scenario.disturbances)
    if (
        disturbances.orbital is not None
        and disturbances.orbital.velocity_m_s > 0.0
        and not scenario.wave_period_s > 0.0
    ):
        raise disturbance_options.DisturbanceError(f"option orbital: scenario {scenario.name} has no waves")
    if disturbances.own_waves is not None and not scenario.wave_yaw_deg > 0.0:
        raise disturbance_options.DisturbanceError(f"option waves: scenario {scenario.name} has no wave yaw")
    return replace(scenario, disturbances=disturbances)


def parse_scenario(text: str) -> Scenario:
    """Parse "NAME" or "NAME+OPTIONS", such as "swell+leeway=8"; raise UnknownScenarioError or DisturbanceError."""
    name, plus, options = text.partition("+")
    return with_disturbances(find_scenario(name), options) if plus else find_scenario(name)


def description_rows(scenario: Scenario) -> list[tuple[str, str]]:
    """Return a scenario's quantities as rows of label and value, for a report."""
    return [
        ("speed through the water", f"{scenario.speed_m_s:g} m/s"),
        ("wave period", f"{scenario.wave_period_s:g} s" if scenario.wave_period_s else "no waves"),
        ("wave yaw, standard deviation", f"{scenario.wave_yaw_deg:g} deg"),
        ("rudder bias", f"{scenario.bias_deg:g} deg, varying by {scenario.drift_deg:g} deg (standard deviation)"),
        ("current", _describe_current(scenario)),
        *disturbance_options.description_rows(scenario.disturbances),
    ]


def _describe_current(scenario: Scenario) -> str:
    if not scenario.current_m_s:
        return "none"
    steady = f"{scenario.current_m_s:g} m/s toward {scenario.current_toward_deg:g} deg"
    return f"{steady}, turning with a tidal period of {scenario.tide_s / 3600.0:g} h" if scenario.tide_s else steady
