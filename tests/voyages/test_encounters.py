"""A hundred random encounters: reported in time, avoided, the fence kept, and the mission continued.

The whole way of the data is in it: ships, what a transponder hears of them, the driver, the tick. The boat is that of
the K-T equation in closed form, on a tick of one second, in a calm sea.
"""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from firmware_py.common.angles import TWO_PI
from firmware_py.common.intents import Arm, Request, SetMode
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanKind, Plans
from firmware_py.common.records import (
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderFeedback,
    Tick,
)
from firmware_py.common.reports import MissionState
from firmware_py.core.state import State
from firmware_py.core.step import step
from firmware_py.faults.table import Fault
from firmware_py.guidance.traffic import MAX_VESSELS
from firmware_py.model.kt import OCEAN_RAMBLER
from firmware_py.sensors.ais import MAX_REPORTS_PER_TICK, AisOptions, AisReceiver
from hil.devices.ais import AisEmulator
from hil.ship.kt_plant import KtPlant
from hil.ship.traffic import OWN_MMSI, PATTERNS, Ship
from support.line import FakeLine
from support.plans import START_RAD, item, placed

TICK_S = 1.0
SPEED_M_S = 0.4
GOAL_M = (800.0, 0.0)
FENCE_M = 450.0  # to either side of the boat's line
MAX_S = 4500.0
# The boat steps aside for 30 m by AIS data, whose course in tenths of a degree leaves 12 m of a ship 14 km away.
WORTH_M, LOST_M = 40.0, 5.0
WAYPOINT, INCLUDED_VERTEX = 16, 5001
CORNERS = ((-300.0, -FENCE_M), (1500.0, -FENCE_M), (1500.0, FENCE_M), (-300.0, FENCE_M))


class Boat:
    """Ship, perfect sensors, transponder and tick."""

    def __init__(self, ships, seed, current_m_s=(0.0, 0.0), **parameters):
        values = ParameterSet().replaced("LOOP_RATE_HZ", 1.0).replaced("FENCE_ENABLE", 1.0)
        for name, value in parameters.items():
            values = values.replaced(name, value)
        mission = Plan.of(PlanKind.MISSION, [item(WAYPOINT, *GOAL_M)])
        fence = Plan.of(PlanKind.FENCE, [item(INCLUDED_VERTEX, *corner, len(CORNERS)) for corner in CORNERS])
        self.state = State.at_start(values, Plans(mission=mission, fence=fence))
        self.plant = KtPlant(OCEAN_RAMBLER.at_speed(SPEED_M_S), TICK_S)
        self.north_m = self.east_m = self.rudder_rad = self.t_s = self.farthest_m = 0.0
        self.current_m_s = current_m_s
        self.index = 0
        self.ships = ships
        self.line = FakeLine()
        self.ears = AisReceiver(self.line, AisOptions(own_mmsi=OWN_MMSI))
        start_deg = tuple(map(math.degrees, START_RAD))
        self.rng, rng = np.random.default_rng([seed, 1]), np.random.default_rng(seed)
        self.transponder = AisEmulator(self, start_deg, ships, rng, own_mmsi=OWN_MMSI, range_m=40_000.0, lost=0.2)
        self.events, self.closest, self.heard_s = [], [(math.inf, 0.0)] * min(3, len(ships)), None
        self.least_margin_m, self.ears_said = math.inf, ""
        self.places_m = {}

    # What the transponder asks.
    def latitude_deg(self):
        return math.degrees(placed(self.north_m, self.east_m)[0])

    def longitude_deg(self):
        return math.degrees(placed(self.north_m, self.east_m)[1])

    def speed_over_ground_m_s(self):
        return SPEED_M_S

    def course_over_ground_rad(self):
        return self.plant.heading_rad % TWO_PI

    def utc_s(self):
        return 1.767e9 + self.t_s

    def over_ground_m_s(self, way_rad):
        north_m_s, east_m_s = self.current_m_s
        return SPEED_M_S * math.cos(way_rad) + north_m_s, SPEED_M_S * math.sin(way_rad) + east_m_s

    def tick(self, *intents):
        self.places_m[self.t_s] = self.north_m, self.east_m
        t_s, noise_rad = self.t_s, self.rng.normal(0.0, math.radians(0.3))  # one that never varies is taken for frozen
        heading_rad = (self.plant.heading_rad + noise_rad) % TWO_PI
        self.line.inbox += self.transponder.take_output(t_s)
        self.ears.receive(t_s)
        vessels, health = tuple(self.ears.poll()), self.ears.health(t_s)
        changed, self.ears_said = health.text != self.ears_said, health.text
        self.reports = len(vessels)
        self.heard_s = t_s if vessels and self.heard_s is None else self.heard_s
        place = placed(self.north_m, self.east_m)
        north_m_s, east_m_s = self.over_ground_m_s(heading_rad)
        speed_m_s, course_rad = math.hypot(north_m_s, east_m_s), math.atan2(east_m_s, north_m_s) % TWO_PI
        fix = PositionSample(t_s, FixType.FIX_3D, *place, 2.0, speed_m_s, course_rad, 11, 0.9, self.utc_s())
        inputs = Inputs(
            Tick(self.index, t_s, 0.0, 0, 1.0 / TICK_S),
            (HeadingSample(t_s, heading_rad, NorthReference.TRUE),),
            (fix,),
            (RudderFeedback(t_s, self.rudder_rad),),
            (health,) if changed else (),
            requests=tuple(Request(t_s, intent) for intent in intents),
            vessels=vessels,
        )
        self.state, output = step(self.state, inputs)
        self.snapshot = output.snapshot
        self.events += [(t_s, event.text) for event in output.events]
        before_rad, self.rudder_rad = self.plant.heading_rad, output.command.shaft_rad
        self.plant.step(self.rudder_rad, 0.0)
        north_m_s, east_m_s = self.over_ground_m_s(0.5 * (before_rad + self.plant.heading_rad))
        self.north_m += TICK_S * north_m_s
        self.east_m += TICK_S * east_m_s
        self.farthest_m = max(self.farthest_m, math.hypot(self.north_m, self.east_m))
        self.index += 1
        self.t_s = TICK_S * self.index
        for number, ship in enumerate(self.ships[:3]):
            north_m, east_m = ship.position_m(self.t_s)
            distance_m = math.hypot(north_m - self.north_m, east_m - self.east_m)
            self.closest[number] = min(self.closest[number], (distance_m, self.t_s))
        margin_m = min(FENCE_M - abs(self.east_m), self.north_m + 300.0, 1500.0 - self.north_m)
        self.least_margin_m = min(self.least_margin_m, margin_m)

    def under_way(self, mode):
        for _ in range(6):
            self.tick()
        self.tick(Arm(armed=True), SetMode(mode))
        assert self.state.modes.mode is mode

    def sail(self):
        """Sail the mission to its end; return this."""
        self.under_way(Mode.AUTO)
        while self.t_s < MAX_S and self.snapshot.mission.state is not MissionState.COMPLETE:
            self.tick()
        return self

    def times_of(self, text):
        return [t_s for t_s, event in self.events if text in event]


@dataclass(frozen=True)
class Outcome:
    """Result of an encounter: distance on the own line and with avoidance, and the time from report to approach."""

    seed: int
    ship: object
    plain_m: float
    best_m: float  # that any heading within the sector comes to from the telling on, by the ship's true way
    aside_m: float
    warned_s: float
    heard_before_s: float
    stepped: bool
    refused: bool
    margin_m: float


def closest_on_line(ship):
    """Return the closest approach to a boat that stays on its line, and its time."""
    times = np.arange(0.0, GOAL_M[0] / SPEED_M_S)
    places = np.array([ship.position_m(t_s) for t_s in times])
    distances = np.hypot(places[:, 0] - SPEED_M_S * times, places[:, 1])
    return float(distances.min()), float(times[distances.argmin()])


def best_distance(ship, report_s, place_m, sector_deg):
    """Return the largest closest approach with a constant heading within the sector, held from the report on.

    One that leads out of the fence before the ship is past is none. Nothing of this is the firmware's.
    """
    times = np.arange(report_s, MAX_S)
    ships, way_m, best_m = np.array([ship.position_m(t_s) for t_s in times]), SPEED_M_S * (times - report_s), 0.0
    for off_deg in np.arange(-sector_deg, sector_deg + 0.5):
        north_m = place_m[0] + way_m * math.cos(math.radians(off_deg))
        east_m = place_m[1] + way_m * math.sin(math.radians(off_deg))
        distances = np.hypot(ships[:, 0] - north_m, ships[:, 1] - east_m)
        past = distances.argmin() + 1
        inside = (
            np.abs(east_m[:past]).max() < FENCE_M and -300.0 < north_m[:past].min() <= north_m[:past].max() < 1500.0
        )
        best_m = max(best_m, float(distances.min())) if inside else best_m
    return best_m


def encountered(seed):
    """Sail an encounter, stepping aside, and check what must hold in each."""
    (ship,) = PATTERNS["encounter"](SPEED_M_S, np.random.default_rng(seed))
    boat = Boat((ship,), seed, AIS_ACT=1.0).sail()
    assert boat.snapshot.mission.state is MissionState.COMPLETE, (seed, ship, boat.events)
    assert boat.least_margin_m > 0.0, (seed, ship)
    assert not boat.times_of("Fence breached")
    assert not boat.snapshot.faults >> Fault.VESSEL_NEAR & 1
    assert len(boat.times_of(": closest ")) == 1, (seed, ship, boat.events)
    (report_s,) = boat.times_of(": closest ")
    plain_m, at_s = closest_on_line(ship)
    sector_deg = boat.state.parameters["AIS_SECTOR_DEG"]
    best_m = best_distance(ship, report_s, boat.places_m[report_s], sector_deg)
    stepped, refused = bool(boat.times_of("Avoidance: heading")), bool(boat.times_of("Avoidance: no better heading"))
    heard_s = at_s - boat.heard_s
    return Outcome(
        seed, ship, plain_m, best_m, boat.closest[0][0], at_s - report_s, heard_s, stepped, refused, boat.least_margin_m
    )


def check(outcome):
    if outcome.heard_before_s >= 720.0:
        assert outcome.warned_s >= 600.0, outcome
    assert outcome.stepped or outcome.refused or outcome.plain_m > 450.0, outcome
    # A ship that approaches at the boat's own speed passes as near on any heading.
    if outcome.best_m > outcome.plain_m + WORTH_M:
        assert outcome.aside_m > outcome.plain_m, outcome
    assert outcome.aside_m > outcome.plain_m - LOST_M, outcome


@pytest.mark.proof
@pytest.mark.timeout(7200)
def test_a_hundred_encounters(figures):
    """`pytest -m proof -s tests/voyages/test_encounters.py`."""
    outcomes = [encountered(seed) for seed in range(1, 101)]
    grown = [one.aside_m - one.plain_m for one in outcomes]
    for one in outcomes:
        print(
            f"{one.seed:3d} {one.ship.speed_m_s:5.1f} m/s {one.ship.course_deg:5.0f} deg {one.ship.station}: "
            f"{one.plain_m:4.0f} m -> {one.aside_m:4.0f} m of {one.best_m:4.0f}, "
            f"reported {one.warned_s / 60.0:4.1f} min before, "
            f"stepped {one.stepped:d} refused {one.refused:d}, fence {one.margin_m:4.0f} m"
        )
    for one in outcomes:
        check(one)
    figures.keep("encounter_reported_min", min(one.warned_s for one in outcomes) / 60.0, "min", "of 100 encounters")
    figures.keep("encounter_grown_least", min(grown), "m", "of 100 encounters")
    figures.keep("encounter_grown_median", float(np.median(grown)), "m", "of 100 encounters")
    able = [one for one in outcomes if one.best_m > one.plain_m + WORTH_M]
    case = f"encounters in which a heading opens the distance by {WORTH_M:.0f} m"
    figures.keep("encounter_able", len(able), "of 100", case)
    gained = [(one.aside_m - one.plain_m) / (one.best_m - one.plain_m) for one in able]
    figures.keep("encounter_gained_median", float(np.median(gained)), "", "of what the best heading would have")
    figures.keep("encounter_stepped", sum(one.stepped for one in outcomes), "of 100", "encounters stepped aside in")
    figures.keep("encounter_fence_least", min(one.margin_m for one in outcomes), "m", "of 100 encounters")


@pytest.mark.parametrize(
    ("place_m", "current_m_s"),
    [
        ((450.0, 5.0), (0.0, 0.0)),
        pytest.param((625.0, -21.0), (-0.11, -0.15), marks=pytest.mark.proof),
        pytest.param((264.0, -36.0), (0.0, 0.0), marks=pytest.mark.proof),
    ],
)
def test_a_ship_at_anchor_on_the_line_is_avoided_and_reported_once(place_m, current_m_s):
    ship = Ship(211000001, "ANCHORED", *place_m, at_anchor=True)
    boat = Boat((ship,), 1, current_m_s, AIS_ACT=1.0).sail()
    assert boat.snapshot.mission.state is MissionState.COMPLETE, boat.events
    assert len(boat.times_of(": closest ")) == 1, boat.events
    assert len(boat.times_of("Avoidance: heading")) == 1, boat.events
    assert boat.closest[0][0] > 100.0
    assert boat.least_margin_m > 200.0  # twice the limit of distance: the boat goes no further to the side


@pytest.mark.proof
def test_station_is_kept_beside_a_ship_at_anchor():
    boat = Boat((Ship(211000001, "ANCHORED", 60.0, 0.0, at_anchor=True),), 3, AIS_ACT=1.0)
    boat.under_way(Mode.LOITER)
    while boat.t_s < 1800.0:
        boat.tick()
    assert boat.times_of("Avoidance: heading")
    assert boat.farthest_m < 200.0, boat.events


def test_the_real_ship_is_reported_among_spoofed_ones():
    ships = PATTERNS["spoofed"](SPEED_M_S, np.random.default_rng(1))
    boat = Boat(ships, 1)
    while boat.t_s < 500.0:
        boat.tick()
    assert boat.times_of("CROSSING LADY: closest") or boat.times_of("MMSI 211000001: closest")
    assert not boat.times_of("DOUBLE")
    assert boat.times_of(f"AIS: another station uses the boat's MMSI {OWN_MMSI:09d}")
    assert len(boat.times_of(": closest ")) <= 30


def test_stations_with_impossible_data_are_ignored():
    ships = PATTERNS["absurd"](SPEED_M_S, np.random.default_rng(1))
    boat = Boat(ships, 1)
    while boat.t_s < 300.0:
        boat.tick()
    assert boat.times_of("CROSSING LADY: closest") or boat.times_of("MMSI 211000001: closest")
    assert {vessel.mmsi for vessel in boat.state.traffic.vessels} == {211_000_001}
    assert boat.times_of("AIS: ")


def test_a_flood_of_ten_thousand_ships_has_bounded_work_a_tick():
    """Work is counted, not timed: reports taken in and vessels looked through."""
    boat = Boat(PATTERNS["flood"](SPEED_M_S, np.random.default_rng(1)), 1, AIS_NEAR_S=1800.0)
    while boat.t_s < 100.0:
        boat.tick()
        assert len(boat.state.traffic.vessels) <= MAX_VESSELS
        assert boat.reports <= MAX_REPORTS_PER_TICK
    assert boat.transponder.unsent > 50_000
    assert boat.state.traffic.rejected > 1000
    assert boat.times_of("CROSSING LADY: closest") or boat.times_of("MMSI 211000001: closest")
