"""Table of other vessels: bounded, checked every two seconds; each approaching vessel is reported once.

AIS reports may be wrong or forged. A position that jumps is not used at once, a full table keeps the vessels that could
arrive first, and of several near vessels one is reported after the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import compass_degrees, degrees, wrap_two_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import DeviceHealth, DeviceRole, Event, Severity
from firmware_py.common.vessels import Vessel, VesselPosition, VesselReport, is_distress_number, merge
from firmware_py.guidance.approach import Velocity, relative

MAX_VESSELS = 100
# For a vessel under way, and for one at rest, which reports every three minutes, not always received.
DROP_AFTER_S, STILL_DROP_AFTER_S = 600.0, 1800.0
CHECK_INTERVAL_S = 2.0
REPORT_INTERVAL_S = 5.0  # between reports of two vessels
REPEAT_INTERVAL_S = 600.0  # of receiver problems and of a distress beacon
MAX_JUMP_M, MAX_SPEED_M_S = 500.0, 60.0  # position error of a valid report, and speed of the fastest craft
CONFIRMATIONS = 3  # consistent positions after which a jump is accepted
# A near vessel is clear beyond this multiple of the near distance: while it moves away, or at its closest approach.
PASSED_FACTOR, CLEAR_FACTOR = 1.1, 3.0
OWN_SPEED_M_S = 0.5
ECHO_DISTANCE_M, ECHO_TRAVEL_M = 40.0, 50.0


class TrafficSettings(msgspec.Struct, frozen=True):
    """Distance and time that count as near, and the speed and distance for vessels at rest."""

    near_m: float
    near_s: float
    still_m: float
    still_m_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> TrafficSettings:
        """Read the settings from the parameters."""
        return cls(
            near_m=parameters["AIS_NEAR_M"],
            near_s=parameters["AIS_NEAR_S"],
            still_m=parameters["AIS_STILL_M"],
            still_m_s=parameters["AIS_STILL_M_S"],
        )

    @property
    def horizon_s(self) -> float:
        """Prediction time of the closest approach."""
        return 2.0 * self.near_s

    def limit_m(self, position: VesselPosition) -> float:
        """Return the distance below which a vessel counts as near."""
        return self.near_m if self._moves(position) else self.still_m

    def drop_after_s(self, position: VesselPosition) -> float:
        """Return the time without reports after which a vessel is removed."""
        return DROP_AFTER_S if self._moves(position) else STILL_DROP_AFTER_S

    def _moves(self, position: VesselPosition) -> bool:
        return position.speed_m_s is not None and position.speed_m_s >= self.still_m_s


class TrafficState(msgspec.Struct, frozen=True):
    """Table of vessels, times of the last check and report, and the number of vessels rejected from a full table.

    `unplaced_mmsi` and `unplaced_s` belong to the last reported distress beacon without a position.
    """

    vessels: tuple[Vessel, ...] = ()
    checked_s: float | None = None
    reported_s: float | None = None
    receiver_reported_s: float | None = None
    rejected: int = 0
    unplaced_mmsi: int = 0
    unplaced_s: float | None = None

    @property
    def near(self) -> bool:
        """Return whether a vessel is near."""
        return any(vessel.near_s is not None for vessel in self.vessels)


class OwnMotion(msgspec.Struct, frozen=True):
    """Position and velocity over ground; in avoidance also the velocities on the unchanged course and back to it."""

    place: Place
    velocity_m_s: Velocity
    own_way_m_s: Velocity | None = None
    back_m_s: Velocity | None = None


def update(
    settings: TrafficSettings,
    state: TrafficState,
    reports: Sequence[VesselReport],
    own: OwnMotion | None,
    now_s: float,
) -> tuple[TrafficState, tuple[Event, ...]]:
    """Enter the reports of a tick and check the table every CHECK_INTERVAL_S; return the state and the events."""
    events: tuple[Event, ...] = ()
    if reports:
        state = _apply_reports(state, reports, own, now_s)
        state, events = _report_unplaced(state, reports, now_s)
    if state.checked_s is not None and 0.0 <= now_s - state.checked_s < CHECK_INTERVAL_S:
        return state, events
    state, distress = _report_distress(replace(state, checked_s=now_s), own, now_s)
    state, more = _check_vessels(settings, state, own, now_s)
    return state, (*events, *distress, *more)


def receiver_events(
    state: TrafficState, devices: Sequence[DeviceHealth], now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    """Return the problems of the receiver as events, at most one in REPEAT_INTERVAL_S."""
    texts = [device.text for device in devices if device.role is DeviceRole.AIS and device.text]
    if not texts or (state.receiver_reported_s is not None and now_s - state.receiver_reported_s < REPEAT_INTERVAL_S):
        return state, ()
    return replace(state, receiver_reported_s=now_s), (Event(Severity.NOTICE, f"AIS: {texts[-1]}"),)


# ------------------------------------------------------------------------- the table


def _apply_reports(
    state: TrafficState, reports: Sequence[VesselReport], own: OwnMotion | None, now_s: float
) -> TrafficState:
    vessels = {vessel.mmsi: vessel for vessel in state.vessels}
    rejected = state.rejected
    for report in reports:
        vessel = vessels.get(report.mmsi)
        if not isinstance(report, VesselPosition):
            if vessel is not None:  # otherwise it is sent again within minutes
                before = vessel.identity
                vessels[report.mmsi] = replace(vessel, identity=report if before is None else merge(before, report))
        elif vessel is not None:
            vessels[report.mmsi] = _with_position(vessel, report)
        else:
            rejected += _admit(vessels, Vessel(report), own, now_s)
    return replace(state, vessels=tuple(vessels.values()), rejected=rejected)


def _admit(vessels: dict[int, Vessel], vessel: Vessel, own: OwnMotion | None, now_s: float) -> bool:
    """Add a new vessel to the table; return whether a vessel was rejected because the table is full."""
    if own is not None:
        vessel = _with_bearing(vessel, own, now_s)
    full = len(vessels) >= MAX_VESSELS
    if full:
        last = max(vessels.values(), key=_arrival_s)
        if _arrival_s(vessel) >= _arrival_s(last):
            return True
        del vessels[last.mmsi]
    vessels[vessel.mmsi] = vessel
    return full


def _arrival_s(vessel: Vessel) -> float:
    """Return the time in which a vessel could arrive; distress beacons, then reported vessels, sort first."""
    if vessel.near_s is not None:
        return 0.0
    if vessel.distress:
        return -1.0
    if vessel.distance_m is None:
        return math.inf
    return vessel.distance_m / ((vessel.position.speed_m_s or 0.0) + OWN_SPEED_M_S)


def _with_position(vessel: Vessel, report: VesselPosition) -> Vessel:
    """Return a vessel with a new position; an impossible one is used only after CONFIRMATIONS reports."""
    if _reachable(vessel.position, report):
        return replace(vessel, position=report, doubted=None, doubts=0)
    doubts = vessel.doubts + 1 if vessel.doubted is not None and _reachable(vessel.doubted, report) else 1
    if doubts >= CONFIRMATIONS:
        return replace(vessel, position=report, doubted=None, doubts=0)
    return replace(vessel, doubted=report, doubts=doubts)


def _reachable(before: VesselPosition, after: VesselPosition) -> bool:
    """Return whether a vessel can have moved from one position to another."""
    place = Place(before.latitude_rad, before.longitude_rad)
    distance_m, _ = place.distance_and_bearing(Place(after.latitude_rad, after.longitude_rad))
    return distance_m <= MAX_JUMP_M + MAX_SPEED_M_S * max(0.0, after.t_s - before.t_s)


# ------------------------------------------------------------------------- check


def _check_vessels(
    settings: TrafficSettings, state: TrafficState, own: OwnMotion | None, now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    recent = [one for one in state.vessels if now_s - one.position.t_s <= settings.drop_after_s(one.position)]
    if own is None:
        unseen = (replace(one, distance_m=None, bearing_rad=None, cpa_m=None, cpa_in_s=None) for one in recent)
        return replace(state, vessels=tuple(unseen)), ()
    vessels = [_with_approach(settings, _with_echo_status(vessel, own, now_s), own, now_s) for vessel in recent]
    state = replace(state, vessels=tuple(vessels))
    echoes = tuple(
        Event(Severity.NOTICE, f"{now.title}: own echo, ignored")
        for now, before in zip(vessels, recent, strict=True)
        if now.own and not before.own
    )
    if state.reported_s is not None and now_s - state.reported_s < REPORT_INTERVAL_S:
        return state, echoes
    others = (at for at, vessel in enumerate(vessels) if vessel.near_s is None and vessel.is_other_vessel)
    coming = [at for at in others if _comes_near(settings, vessels[at], own, now_s)]
    if not coming:
        return state, echoes
    first = min(coming, key=lambda at: vessels[at].cpa_in_s or 0.0)
    vessels[first] = replace(vessels[first], near_s=now_s)
    event = Event(Severity.WARNING, near_text(vessels[first]))
    return replace(state, vessels=tuple(vessels), reported_s=now_s), (*echoes, event)


def _with_echo_status(vessel: Vessel, own: OwnMotion, now_s: float) -> Vessel:
    """Return a vessel with its echo status: whether it is the transponder of the boat itself.

    It is, once it has moved by ECHO_TRAVEL_M and never been farther than ECHO_DISTANCE_M from the boat.
    """
    if now_s - vessel.position.t_s > CHECK_INTERVAL_S:
        return vessel
    place = Place(vessel.position.latitude_rad, vessel.position.longitude_rad)
    if own.place.distance_and_bearing(place)[0] > ECHO_DISTANCE_M:
        return vessel if vessel.beside_s is None else replace(vessel, beside_s=None, own=False)
    if vessel.beside_s is None:
        return replace(vessel, beside_s=vessel.position.t_s, beside_rad=(place.latitude_rad, place.longitude_rad))
    if vessel.own or place.distance_and_bearing(Place(*vessel.beside_rad))[0] < ECHO_TRAVEL_M:
        return vessel
    return replace(vessel, own=True)


# ------------------------------------------------------------------------- distress beacons


def _report_distress(
    state: TrafficState, own: OwnMotion | None, now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    """Report the distress beacon that has waited longest, by bearing and distance if known, else by position."""
    vessels = list(state.vessels)
    waiting = [at for at, vessel in enumerate(vessels) if vessel.distress and _report_due(vessel, own, now_s)]
    if not waiting:
        return state, ()
    first = min(waiting, key=lambda at: -math.inf if vessels[at].reported_s is None else vessels[at].reported_s or 0.0)
    vessel = vessels[first] = replace(vessels[first], reported_s=now_s, bearing_reported=own is not None)
    if own is None:
        position = vessel.position
        latitude_deg, longitude_deg = degrees(position.latitude_rad), degrees(position.longitude_rad)
        text = f"Distress beacon {vessel.mmsi:09d}: at {latitude_deg:.4f}, {longitude_deg:.4f}"
    else:
        offset = _with_bearing(vessel, own, now_s)
        bearing_deg = compass_degrees(offset.bearing_rad or 0.0)
        text = f"Distress beacon {vessel.mmsi:09d}: {offset.distance_m:.0f} m, bearing {bearing_deg:03.0f} deg"
    return replace(state, vessels=tuple(vessels)), (Event(Severity.CRITICAL, text),)


def _report_due(vessel: Vessel, own: OwnMotion | None, now_s: float) -> bool:
    """Return whether a distress beacon is new, is due again, or now has a bearing that was unknown."""
    if vessel.reported_s is None:
        return True
    return (own is not None and not vessel.bearing_reported) or now_s - vessel.reported_s >= REPEAT_INTERVAL_S


def _report_unplaced(
    state: TrafficState, reports: Sequence[VesselReport], now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    """Report a distress beacon without a position."""
    placed = {vessel.mmsi for vessel in state.vessels}
    calls = (one.mmsi for one in reports if is_distress_number(one.mmsi) and one.mmsi not in placed)
    mmsi = next(calls, None)
    before_s = -math.inf if state.unplaced_s is None else state.unplaced_s
    if mmsi is None or now_s - before_s < (REPEAT_INTERVAL_S if mmsi == state.unplaced_mmsi else REPORT_INTERVAL_S):
        return state, ()
    event = Event(Severity.CRITICAL, f"Distress beacon {mmsi:09d}: no position yet")
    return replace(state, unplaced_mmsi=mmsi, unplaced_s=now_s), (event,)


def _with_bearing(vessel: Vessel, own: OwnMotion, now_s: float) -> Vessel:
    """Return a vessel with its distance and bearing."""
    offset = relative(own.place, vessel.position, now_s)
    bearing_rad = wrap_two_pi(math.atan2(offset.east_m, offset.north_m))
    return replace(vessel, distance_m=math.hypot(offset.north_m, offset.east_m), bearing_rad=bearing_rad)


def _with_approach(settings: TrafficSettings, vessel: Vessel, own: OwnMotion, now_s: float) -> Vessel:
    """Return a vessel with its present distance and closest approach; a passed vessel is no longer near."""
    offset = relative(own.place, vessel.position, now_s)
    cpa_m, cpa_in_s = offset.nearest(own.velocity_m_s, settings.horizon_s)
    distance_m = math.hypot(offset.north_m, offset.east_m)
    limit_m = settings.limit_m(vessel.position)
    over = (cpa_in_s <= 0.0 and distance_m > PASSED_FACTOR * limit_m) or cpa_m > CLEAR_FACTOR * limit_m
    if own.own_way_m_s is not None:  # avoidance increases the distance: it must have passed the unchanged course, too
        over = over and offset.nearest(own.own_way_m_s, settings.horizon_s)[1] <= 0.0
    if own.back_m_s is not None:  # and the way back must not lead near it
        over = over and offset.nearest(own.back_m_s, settings.horizon_s)[0] > PASSED_FACTOR * limit_m
    return replace(
        vessel,
        distance_m=distance_m,
        bearing_rad=wrap_two_pi(math.atan2(offset.east_m, offset.north_m)),
        cpa_m=cpa_m,
        cpa_in_s=cpa_in_s,
        near_s=None if over or not vessel.is_other_vessel else vessel.near_s,
    )


def _comes_near(settings: TrafficSettings, vessel: Vessel, own: OwnMotion, now_s: float) -> bool:
    limit_m = settings.limit_m(vessel.position)
    if vessel.cpa_m is None or vessel.cpa_m > limit_m:
        return False
    by_then_m, _ = relative(own.place, vessel.position, now_s).nearest(own.velocity_m_s, settings.near_s)
    return by_then_m <= limit_m


def near_text(vessel: Vessel) -> str:
    """Return the text of a warning: vessel, closest approach, time and bearing."""
    minutes, bearing = (vessel.cpa_in_s or 0.0) / 60.0, compass_degrees(vessel.bearing_rad or 0.0)
    return f"{vessel.title}: closest {vessel.cpa_m or 0.0:.0f} m in {minutes:.0f} min, bearing {bearing:.0f} deg"
