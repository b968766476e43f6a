"""The table of other vessels: bounded, looked through every two seconds, and who comes near told once.

What is in it was sent by others and may be wrong or a lie: a vessel that leaps is not believed at once, the table keeps
those that could be here soonest, and of many that come near one is told after the other.
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
from firmware_py.common.vessels import Vessel, VesselPosition, VesselReport, is_distress_number, merged
from firmware_py.guidance.approach import Velocity, relative

MOST_VESSELS = 100
# A vessel under way, and what lies still: that sends every three minutes at most, some of it lost, and is still there.
FORGOTTEN_AFTER_S, STILL_FORGOTTEN_AFTER_S = 600.0, 1800.0
LOOK_S = 2.0
TELL_S = 5.0  # between two vessels
TELL_AGAIN_S = 600.0  # what the receiver says of itself, and a distress beacon
LEAP_M, FASTEST_M_S = 500.0, 60.0  # what a sound position may be off, and the fastest craft
BELIEVED_AFTER = 3  # doubted positions in a row that agree with each other
PAST = 1.1  # of the distance, once the vessel goes away
CLEAR = 3.0  # of the distance
OWN_SPEED_M_S = 0.5
ECHO_M, ECHO_WAY_M = 40.0, 50.0


class TrafficSettings(msgspec.Struct, frozen=True):
    """When a vessel is near: the distance and the time, and what counts as lying still, with a distance of its own."""

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
        """How far ahead a closest approach is looked for, so that it is found of a vessel that is near only then."""
        return 2.0 * self.near_s

    def limit_m(self, position: VesselPosition) -> float:
        """Return how near a vessel may come before it is told of."""
        return self.near_m if self._moves(position) else self.still_m

    def forgotten_after_s(self, position: VesselPosition) -> float:
        """Return how long a vessel may be silent before it is forgotten."""
        return FORGOTTEN_AFTER_S if self._moves(position) else STILL_FORGOTTEN_AFTER_S

    def _moves(self, position: VesselPosition) -> bool:
        return position.speed_m_s is not None and position.speed_m_s >= self.still_m_s


class TrafficState(msgspec.Struct, frozen=True):
    """The vessels, the times of the last check and of the last report, and how many did not fit.

    `unplaced_mmsi` and `unplaced_s` are of the distress beacon without a position that was reported last.
    """

    vessels: tuple[Vessel, ...] = ()
    looked_s: float | None = None
    told_s: float | None = None
    receiver_told_s: float | None = None
    turned_away: int = 0
    unplaced_mmsi: int = 0
    unplaced_s: float | None = None

    @property
    def near(self) -> bool:
        """Whether a vessel is near."""
        return any(vessel.near_s is not None for vessel in self.vessels)


class OwnMotion(msgspec.Struct, frozen=True):
    """Where the boat is and how it moves over ground; while it steps aside, how on its own way, and back to it."""

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
    """Take the reports of a tick in and, every LOOK_S, look through the table; return what is to be told."""
    events: tuple[Event, ...] = ()
    if reports:
        state = _take(state, reports, own, now_s)
        state, events = _report_unplaced(state, reports, now_s)
    if state.looked_s is not None and 0.0 <= now_s - state.looked_s < LOOK_S:
        return state, events
    state, distress = _report_distress(replace(state, looked_s=now_s), own, now_s)
    state, more = _look_through(settings, state, own, now_s)
    return state, (*events, *distress, *more)


def receiver_events(
    state: TrafficState, devices: Sequence[DeviceHealth], now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    """Return what is wrong with the receiver or refused by it, told now and then: its status has all of it."""
    texts = [device.text for device in devices if device.role is DeviceRole.AIS and device.text]
    if not texts or (state.receiver_told_s is not None and now_s - state.receiver_told_s < TELL_AGAIN_S):
        return state, ()
    return replace(state, receiver_told_s=now_s), (Event(Severity.NOTICE, f"AIS: {texts[-1]}"),)


# ------------------------------------------------------------------------- the table


def _take(state: TrafficState, reports: Sequence[VesselReport], own: OwnMotion | None, now_s: float) -> TrafficState:
    vessels = {vessel.mmsi: vessel for vessel in state.vessels}
    turned_away = state.turned_away
    for report in reports:
        vessel = vessels.get(report.mmsi)
        if not isinstance(report, VesselPosition):
            if vessel is not None:  # else it is told again in some minutes
                before = vessel.identity
                vessels[report.mmsi] = replace(vessel, identity=report if before is None else merged(before, report))
        elif vessel is not None:
            vessels[report.mmsi] = _moved(vessel, report)
        else:
            turned_away += _admit(vessels, Vessel(report), own, now_s)
    return replace(state, vessels=tuple(vessels.values()), turned_away=turned_away)


def _admit(vessels: dict[int, Vessel], vessel: Vessel, own: OwnMotion | None, now_s: float) -> bool:
    """Put a new vessel into the table; whether there was no room, for it or for another one."""
    if own is not None:
        vessel = _seen(vessel, own, now_s)
    full = len(vessels) >= MOST_VESSELS
    if full:
        last = max(vessels.values(), key=_soonest_s)
        if _soonest_s(vessel) >= _soonest_s(last):
            return True
        del vessels[last.mmsi]
    vessels[vessel.mmsi] = vessel
    return full


def _soonest_s(vessel: Vessel) -> float:
    """Return how soon a vessel could be here; distress beacons, then reported vessels, have the first places."""
    if vessel.near_s is not None:
        return 0.0
    if vessel.distress:
        return -1.0
    if vessel.distance_m is None:
        return math.inf
    return vessel.distance_m / ((vessel.position.speed_m_s or 0.0) + OWN_SPEED_M_S)


def _moved(vessel: Vessel, report: VesselPosition) -> Vessel:
    """Return a vessel after a report of its position, which is doubted when it cannot have come there."""
    if _reachable(vessel.position, report):
        return replace(vessel, position=report, doubted=None, doubts=0)
    doubts = vessel.doubts + 1 if vessel.doubted is not None and _reachable(vessel.doubted, report) else 1
    if doubts >= BELIEVED_AFTER:
        return replace(vessel, position=report, doubted=None, doubts=0)
    return replace(vessel, doubted=report, doubts=doubts)


def _reachable(before: VesselPosition, after: VesselPosition) -> bool:
    """Whether a vessel can have come from one position to another."""
    place = Place(before.latitude_rad, before.longitude_rad)
    distance_m, _ = place.distance_and_bearing(Place(after.latitude_rad, after.longitude_rad))
    return distance_m <= LEAP_M + FASTEST_M_S * max(0.0, after.t_s - before.t_s)


# ------------------------------------------------------------------------- the look through it


def _look_through(
    settings: TrafficSettings, state: TrafficState, own: OwnMotion | None, now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    kept = [one for one in state.vessels if now_s - one.position.t_s <= settings.forgotten_after_s(one.position)]
    if own is None:
        unseen = (replace(one, distance_m=None, bearing_rad=None, cpa_m=None, cpa_in_s=None) for one in kept)
        return replace(state, vessels=tuple(unseen)), ()
    vessels = [_judged(settings, _told_apart(vessel, own, now_s), own, now_s) for vessel in kept]
    state = replace(state, vessels=tuple(vessels))
    echoes = tuple(
        Event(Severity.NOTICE, f"{now.title} is always where the boat is: its own echo")
        for now, before in zip(vessels, kept, strict=True)
        if now.own and not before.own
    )
    if state.told_s is not None and now_s - state.told_s < TELL_S:
        return state, echoes
    others = (at for at, vessel in enumerate(vessels) if vessel.near_s is None and vessel.warned_of)
    coming = [at for at in others if _comes_near(settings, vessels[at], own, now_s)]
    if not coming:
        return state, echoes
    first = min(coming, key=lambda at: vessels[at].cpa_in_s or 0.0)
    vessels[first] = replace(vessels[first], near_s=now_s)
    event = Event(Severity.WARNING, near_text(vessels[first]))
    return replace(state, vessels=tuple(vessels), told_s=now_s), (*echoes, event)


def _told_apart(vessel: Vessel, own: OwnMotion, now_s: float) -> Vessel:
    """Return a vessel with what its newest report says of whether it is the boat itself, heard from outside.

    It is, once it has moved by ECHO_WAY_M and never been further than ECHO_M from the boat.
    """
    if now_s - vessel.position.t_s > LOOK_S:
        return vessel
    place = Place(vessel.position.latitude_rad, vessel.position.longitude_rad)
    if own.place.distance_and_bearing(place)[0] > ECHO_M:
        return vessel if vessel.beside_s is None else replace(vessel, beside_s=None, own=False)
    if vessel.beside_s is None:
        return replace(vessel, beside_s=vessel.position.t_s, beside_rad=(place.latitude_rad, place.longitude_rad))
    if vessel.own or place.distance_and_bearing(Place(*vessel.beside_rad))[0] < ECHO_WAY_M:
        return vessel
    return replace(vessel, own=True)


# ------------------------------------------------------------------------- distress beacons


def _report_distress(
    state: TrafficState, own: OwnMotion | None, now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    """Report the distress beacon that waits longest by bearing and distance, by its place while those are unknown."""
    vessels = list(state.vessels)
    waiting = [at for at, vessel in enumerate(vessels) if vessel.distress and _is_to_be_reported(vessel, own, now_s)]
    if not waiting:
        return state, ()
    first = min(waiting, key=lambda at: -math.inf if vessels[at].reported_s is None else vessels[at].reported_s or 0.0)
    vessel = vessels[first] = replace(vessels[first], reported_s=now_s, bearing_reported=own is not None)
    if own is None:
        position = vessel.position
        latitude_deg, longitude_deg = degrees(position.latitude_rad), degrees(position.longitude_rad)
        text = f"Distress beacon {vessel.mmsi:09d}: at {latitude_deg:.4f}, {longitude_deg:.4f}"
    else:
        seen = _seen(vessel, own, now_s)
        bearing_deg = compass_degrees(seen.bearing_rad or 0.0)
        text = f"Distress beacon {vessel.mmsi:09d}: {seen.distance_m:.0f} m, bearing {bearing_deg:03.0f} deg"
    return replace(state, vessels=tuple(vessels)), (Event(Severity.CRITICAL, text),)


def _is_to_be_reported(vessel: Vessel, own: OwnMotion | None, now_s: float) -> bool:
    """Whether a distress beacon is new, was reported long ago, or without a bearing that is known now."""
    if vessel.reported_s is None:
        return True
    return (own is not None and not vessel.bearing_reported) or now_s - vessel.reported_s >= TELL_AGAIN_S


def _report_unplaced(
    state: TrafficState, reports: Sequence[VesselReport], now_s: float
) -> tuple[TrafficState, tuple[Event, ...]]:
    """Report a distress beacon that has sent no position yet."""
    placed = {vessel.mmsi for vessel in state.vessels}
    calls = (one.mmsi for one in reports if is_distress_number(one.mmsi) and one.mmsi not in placed)
    mmsi = next(calls, None)
    before_s = -math.inf if state.unplaced_s is None else state.unplaced_s
    if mmsi is None or now_s - before_s < (TELL_AGAIN_S if mmsi == state.unplaced_mmsi else TELL_S):
        return state, ()
    event = Event(Severity.CRITICAL, f"Distress beacon {mmsi:09d}: no position yet")
    return replace(state, unplaced_mmsi=mmsi, unplaced_s=now_s), (event,)


def _seen(vessel: Vessel, own: OwnMotion, now_s: float) -> Vessel:
    """Return a vessel with its distance and bearing."""
    seen = relative(own.place, vessel.position, now_s)
    bearing_rad = wrap_two_pi(math.atan2(seen.east_m, seen.north_m))
    return replace(vessel, distance_m=math.hypot(seen.north_m, seen.east_m), bearing_rad=bearing_rad)


def _judged(settings: TrafficSettings, vessel: Vessel, own: OwnMotion, now_s: float) -> Vessel:
    """Return a vessel as it is seen now, with how near it comes; one that has gone by is near no more."""
    seen = relative(own.place, vessel.position, now_s)
    cpa_m, cpa_in_s = seen.nearest(own.velocity_m_s, settings.horizon_s)
    distance_m = math.hypot(seen.north_m, seen.east_m)
    limit_m = settings.limit_m(vessel.position)
    over = (cpa_in_s <= 0.0 and distance_m > PAST * limit_m) or cpa_m > CLEAR * limit_m
    if own.own_way_m_s is not None:  # stepping aside opens the distance: what counts is whether it is past on her way
        over = over and seen.nearest(own.own_way_m_s, settings.horizon_s)[1] <= 0.0
    if own.back_m_s is not None:  # and that the way back to it, which may lead close behind, does not come near either
        over = over and seen.nearest(own.back_m_s, settings.horizon_s)[0] > PAST * limit_m
    return replace(
        vessel,
        distance_m=distance_m,
        bearing_rad=wrap_two_pi(math.atan2(seen.east_m, seen.north_m)),
        cpa_m=cpa_m,
        cpa_in_s=cpa_in_s,
        near_s=None if over or not vessel.warned_of else vessel.near_s,
    )


def _comes_near(settings: TrafficSettings, vessel: Vessel, own: OwnMotion, now_s: float) -> bool:
    limit_m = settings.limit_m(vessel.position)
    if vessel.cpa_m is None or vessel.cpa_m > limit_m:
        return False
    by_then_m, _ = relative(own.place, vessel.position, now_s).nearest(own.velocity_m_s, settings.near_s)
    return by_then_m <= limit_m


def near_text(vessel: Vessel) -> str:
    """Say who comes how near, when and from where."""
    minutes, bearing = (vessel.cpa_in_s or 0.0) / 60.0, compass_degrees(vessel.bearing_rad or 0.0)
    return f"{vessel.title} comes to {vessel.cpa_m or 0.0:.0f} m in {minutes:.0f} min, from {bearing:.0f} deg"
