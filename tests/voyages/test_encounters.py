"""Random encounters with ships: reported in time and avoided, inside the fence, and the mission continues.

The whole data path is simulated: ships, transponder, driver and tick. The boat is that of the K-T equation in closed
form, with a tick of one second, in a calm sea.
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
from firmware_py.sensors.ais import AisOptions, AisReceiver
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
# The autopilot avoids for a gain of 30 m by AIS data, whose course resolution means 12 m at a distance of 14 km.
MIN_POSSIBLE_GAIN_M, MAX_LOSS_M = 40.0, 5.0
WAYPOINT, INCLUDED_VERTEX = 16, 5001
CORNERS = ((-300.0, -FENCE_M), (1500.0, -FENCE_M), (1500.0, FENCE_M), (-300.0, FENCE_M))


class Boat:
    """Boat with perfect sensors, transponder and the autopilot's tick."""

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
        self.receiver = AisReceiver(self.line, AisOptions(own_mmsi=OWN_MMSI))
        start_deg = tuple(map(math.degrees, START_RAD))
        self.rng, rng = np.random.default_rng([seed, 1]), np.random.default_rng(seed)
        self.transponder = AisEmulator(self, start_deg, ships, rng, own_mmsi=OWN_MMSI, range_m=40_000.0, lost=0.2)
        self.events, self.closest, self.heard_s = [], [(math.inf, 0.0)] * min(3, len(ships)), None
        self.min_margin_m, self.health_text = math.inf, ""
        self.positions_m = {}

    # interface of the transponder
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

    def over_ground_m_s(self, heading_rad):
        north_m_s, east_m_s = self.current_m_s
        return SPEED_M_S * math.cos(heading_rad) + north_m_s, SPEED_M_S * math.sin(heading_rad) + east_m_s

    def tick(self, *intents):
        self.positions_m[self.t_s] = self.north_m, self.east_m
        t_s = self.t_s
        noise_rad = self.rng.normal(0.0, math.radians(0.3))  # a constant heading would be reported as frozen
        heading_rad = (self.plant.heading_rad + noise_rad) % TWO_PI
        self.line.inbox += self.transponder.take_output(t_s)
        self.receiver.receive(t_s)
        vessels, health = tuple(self.receiver.poll()), self.receiver.health(t_s)
        changed, self.health_text = health.text != self.health_text, health.text
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
        self.min_margin_m = min(self.min_margin_m, margin_m)

    def get_under_way(self, mode):
        for _ in range(6):
            self.tick()
        self.tick(Arm(armed=True), SetMode(mode))
        assert self.state.modes.mode is mode

    def sail(self):
        """Sail the mission to its end; return self."""
        self.get_under_way(Mode.AUTO)
        while self.t_s < MAX_S and self.snapshot.mission.state is not MissionState.COMPLETE:
            self.tick()
        return self

    def times_of(self, text):
        return [t_s for t_s, event in self.events if text in event]


@dataclass(frozen=True)
class Outcome:
    """Result of an encounter: closest approaches, and times from report and first reception to the closest approach."""

    seed: int
    ship: object
    line_m: float
    best_m: (
        float  # largest closest approach of any heading within the sector from the report on, by the ship's true track
    )
    avoided_m: float
    warning_s: float
    heard_before_s: float
    has_avoided: bool
    has_refused: bool
    margin_m: float


def closest_on_line(ship):
    """Return distance and time of the closest approach to a boat that stays on its line."""
    times = np.arange(0.0, GOAL_M[0] / SPEED_M_S)
    places = np.array([ship.position_m(t_s) for t_s in times])
    distances = np.hypot(places[:, 0] - SPEED_M_S * times, places[:, 1])
    return float(distances.min()), float(times[distances.argmin()])


def best_distance(ship, report_s, position_m, sector_deg):
    """Return the largest closest approach with a constant heading within the sector from the report on.

    Headings that leave the fence before the closest approach are ignored. No function of the firmware is used.
    """
    times = np.arange(report_s, MAX_S)
    ships, way_m, best_m = np.array([ship.position_m(t_s) for t_s in times]), SPEED_M_S * (times - report_s), 0.0
    for change_deg in np.arange(-sector_deg, sector_deg + 0.5):
        north_m = position_m[0] + way_m * math.cos(math.radians(change_deg))
        east_m = position_m[1] + way_m * math.sin(math.radians(change_deg))
        distances = np.hypot(ships[:, 0] - north_m, ships[:, 1] - east_m)
        passed_index = distances.argmin() + 1
        is_inside = (
            np.abs(east_m[:passed_index]).max() < FENCE_M
            and -300.0 < north_m[:passed_index].min() <= north_m[:passed_index].max() < 1500.0
        )
        best_m = max(best_m, float(distances.min())) if is_inside else best_m
    return best_m


def sail_encounter(seed):
    """Sail an encounter with avoidance, check the conditions for all encounters, and return the outcome."""
    (ship,) = PATTERNS["encounter"](SPEED_M_S, np.random.default_rng(seed))
    boat = Boat((ship,), seed, AIS_ACT=1.0).sail()
    assert boat.snapshot.mission.state is MissionState.COMPLETE, (seed, ship, boat.events)
    assert boat.min_margin_m > 0.0, (seed, ship)
    assert not boat.times_of("Fence breached")
    assert not boat.snapshot.faults >> Fault.VESSEL_NEAR & 1
    assert len(boat.times_of(": closest ")) == 1, (seed, ship, boat.events)
    (report_s,) = boat.times_of(": closest ")
    line_m, at_s = closest_on_line(ship)
    sector_deg = boat.state.parameters["AIS_SECTOR_DEG"]
    best_m = best_distance(ship, report_s, boat.positions_m[report_s], sector_deg)
    has_avoided, has_refused = (
        bool(boat.times_of("Avoidance: heading")),
        bool(boat.times_of("Avoidance: no better heading")),
    )
    heard_s = at_s - boat.heard_s
    return Outcome(
        seed,
        ship,
        line_m,
        best_m,
        boat.closest[0][0],
        at_s - report_s,
        heard_s,
        has_avoided,
        has_refused,
        boat.min_margin_m,
    )


def check(outcome):
    if outcome.heard_before_s >= 720.0:
        assert outcome.warning_s >= 600.0, outcome
    assert outcome.has_avoided or outcome.has_refused or outcome.line_m > 450.0, outcome
    # A ship that approaches at the boat's own speed passes at the same distance on any heading.
    if outcome.best_m > outcome.line_m + MIN_POSSIBLE_GAIN_M:
        assert outcome.avoided_m > outcome.line_m, outcome
    assert outcome.avoided_m > outcome.line_m - MAX_LOSS_M, outcome


@pytest.mark.proof
@pytest.mark.timeout(7200)
def test_hundred_encounters_are_reported_and_avoided(figures):
    outcomes = [sail_encounter(seed) for seed in range(1, 101)]
    gains_m = [outcome.avoided_m - outcome.line_m for outcome in outcomes]
    for outcome in outcomes:
        print(
            f"{outcome.seed:3d} {outcome.ship.speed_m_s:5.1f} m/s {outcome.ship.course_deg:5.0f} deg "
            f"{outcome.ship.station}: {outcome.line_m:4.0f} m -> {outcome.avoided_m:4.0f} m of {outcome.best_m:4.0f}, "
            f"reported {outcome.warning_s / 60.0:4.1f} min before, "
            f"stepped {outcome.has_avoided:d} refused {outcome.has_refused:d}, fence {outcome.margin_m:4.0f} m"
        )
    for outcome in outcomes:
        check(outcome)
    figures.keep(
        "encounter_reported_min", min(outcome.warning_s for outcome in outcomes) / 60.0, "min", "of 100 encounters"
    )
    figures.keep("encounter_grown_least", min(gains_m), "m", "of 100 encounters")
    figures.keep("encounter_grown_median", float(np.median(gains_m)), "m", "of 100 encounters")
    avoidable = [outcome for outcome in outcomes if outcome.best_m > outcome.line_m + MIN_POSSIBLE_GAIN_M]
    case = f"encounters in which a heading opens the distance by {MIN_POSSIBLE_GAIN_M:.0f} m"
    figures.keep("encounter_able", len(avoidable), "of 100", case)
    gain_fractions = [(outcome.avoided_m - outcome.line_m) / (outcome.best_m - outcome.line_m) for outcome in avoidable]
    figures.keep("encounter_gained_median", float(np.median(gain_fractions)), "", "of what the best heading would have")
    figures.keep(
        "encounter_stepped", sum(outcome.has_avoided for outcome in outcomes), "of 100", "encounters stepped aside in"
    )
    figures.keep("encounter_fence_least", min(outcome.margin_m for outcome in outcomes), "m", "of 100 encounters")


@pytest.mark.parametrize(
    ("position_m", "current_m_s"),
    [
        ((450.0, 5.0), (0.0, 0.0)),
        pytest.param((625.0, -21.0), (-0.11, -0.15), marks=pytest.mark.proof),
        pytest.param((264.0, -36.0), (0.0, 0.0), marks=pytest.mark.proof),
    ],
)
def test_ship_at_anchor_on_the_line_is_avoided_and_reported_once(position_m, current_m_s):
    ship = Ship(211000001, "ANCHORED", *position_m, at_anchor=True)
    boat = Boat((ship,), 1, current_m_s, AIS_ACT=1.0).sail()
    assert boat.snapshot.mission.state is MissionState.COMPLETE, boat.events
    assert len(boat.times_of(": closest ")) == 1, boat.events
    assert len(boat.times_of("Avoidance: heading")) == 1, boat.events
    assert boat.closest[0][0] > 100.0
    assert boat.min_margin_m > 200.0  # twice the limit of the distance: the boat avoids no further


@pytest.mark.proof
def test_boat_loiters_near_a_ship_at_anchor():
    boat = Boat((Ship(211000001, "ANCHORED", 60.0, 0.0, at_anchor=True),), 3, AIS_ACT=1.0)
    boat.get_under_way(Mode.LOITER)
    while boat.t_s < 1800.0:
        boat.tick()
    assert boat.times_of("Avoidance: heading")
    assert boat.farthest_m < 200.0, boat.events


def test_real_ship_is_reported_among_spoofed_ones():
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


def test_work_per_tick_is_limited_with_ten_thousand_ships():
    """Work is measured by the numbers of reports and vessels."""
    boat = Boat(PATTERNS["flood"](SPEED_M_S, np.random.default_rng(1)), 1, AIS_NEAR_S=1800.0)
    while boat.t_s < 100.0:
        boat.tick()
        assert len(boat.state.traffic.vessels) <= MAX_VESSELS
        assert boat.reports <= 40
    assert boat.transponder.unsent > 50_000
    assert boat.state.traffic.rejected > 1000
    assert boat.times_of("CROSSING LADY: closest") or boat.times_of("MMSI 211000001: closest")
