"""The state between ticks as text and back, bit for bit: the checkpoints of the log.

CHANGES is the one table of how the records of the state, and of what outlives a restart
(resume.py), are different from version to version. Whoever renames a class or a field that State
or Resume hold, or moves a field, adds a `Change` (common/record_history.py says how) or a row to the one
that no release has written yet. Logs and boats at sea then go on as before; a row that was
forgotten shows as a note in the replay of tests/replay/data.

Faults stand by name, so that a fault more or less changes nothing for the others: a fault that is
new was never set, one that is not known is ignored and reported. Parameters stand by name, too: one
that is missing, or whose value is not allowed any more, has its default.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable
from enum import IntEnum
from typing import Any

from firmware_py.common.json_codec import Codec, FieldHook, Hook
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import INDEX
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import HOOK as PLAN_HOOK
from firmware_py.common.reading_notes import Spot, number, shown
from firmware_py.common.record_history import Change, Record
from firmware_py.core.state import State
from firmware_py.faults.latch import LatchState
from firmware_py.faults.table import Fault
from firmware_py.safety.failsafe import FailsafeState

# The faults of version 1 in their order; it does not follow the table of today.
FAULTS_OF_VERSION_1 = (
    "COMPASS_LOST",
    "POSITION_LOST",
    "RUDDER_SILENT",
    "RUDDER_ERROR",
    "LOOP_LATE",
    "STORAGE_FAILING",
    "CURRENT_STRONG",
    "MISSION_UNUSABLE",
    "FENCE_BREACHED",
    "COMPASS_SILENT",
    "COMPASS_FROZEN",
    "COMPASS_JUMPING",
    "COMPASS_DISAGREES",
    "POSITION_JUMPING",
    "RUDDER_ASTRAY",
    "RUDDER_JAMMED",
    "RUDDER_HOT",
    "RUDDER_OVERLOADED",
    "RUDDER_REPOWERED",
    "SUPPLY_LOW",
    "STORAGE_FULL",
    "CLOCK_STEPPED",
    "STATION_SILENT",
    "STEERING_LOST",
)


def _monitor_by_name(record: Record) -> None:
    """Name the faults of a MonitorState of version 1: tuples by index, bits."""
    for name in ("since_s", "stood_s"):
        if name in record:
            pairs = zip(FAULTS_OF_VERSION_1, record[name], strict=False)  # there have been fewer
            record[name] = {fault: value for fault, value in pairs if value is not None}
    _bits_by_name(record, "active")


def _failsafe_by_name(record: Record) -> None:
    """Name the faults of a FailsafeState of version 1: bits, an index."""
    _bits_by_name(record, "known")
    _bits_by_name(record, "calling")
    if record.get("fault") is not None:
        record["fault"] = FAULTS_OF_VERSION_1[record["fault"]]


def _rudder_unknown(record: Record) -> None:
    """Leave the mean rudder of a SteeringMonitorState away where there was none yet: it is a number now."""
    if record.get("slow_rudder_rad", 0.0) is None:
        del record["slow_rudder_rad"]


def _bits_by_name(record: Record, name: str) -> None:
    if name in record:
        record[name] = [fault for bit, fault in enumerate(FAULTS_OF_VERSION_1) if record[name] >> bit & 1]


def _given_up(record: str, *names: str) -> tuple[tuple[str, None], ...]:
    return tuple((f"{record}.{name}", None) for name in names)


CHANGES: tuple[Change, ...] = (
    Change(
        2,
        moved=(
            ("LookoutState.waves", "LookoutState.wave_filter"),
            ("FilterState.refused", "FilterState.refusals"),
            ("FilterState.learned", "FilterState.noise_model"),
            ("Learned.last", "Learned.last_innovation"),
            ("Learned.slow", "Learned.slow_innovation"),
            ("CompassState.apart_rad", "CompassState.difference_rad"),
            ("PositionState.doubted", "PositionState.suspect"),
            ("State.started_s", "State.timing.started_s"),
            ("State.t_s", "State.timing.t_s"),
            ("State.skipped_total", "State.timing.skipped_total"),
            ("State.skipped_t_s", "State.timing.skipped_t_s"),
            ("State.storage", "State.devices.storage"),
            ("State.watch.clock", "State.devices.clock"),
            ("State.watch.link", "State.devices.link"),
            ("State.watch.heard_s", "State.devices.compass_s"),
            ("State.rudder_command_rad", "State.rudder.command_rad"),
            ("State.servo", "State.rudder.feedback"),
            ("State.watch.restarts", "State.rudder.restarts"),
            ("State.watch.restarted_s", "State.rudder.restarted_s"),
            ("State.lookout", "State.heading_estimator"),
            ("State.heading", "State.heading_estimator.heading"),
            ("State.position", None),  # State.place.fix is the same
            ("State.place", "State.position"),
            ("State.current", "State.water"),
            ("State.nav", "State.guidance"),
            ("State.monitor", "State.fault_latch"),
            ("State.watch.energy", "State.energy_meter"),
            ("State.watch.rest", "State.torque_release"),
            ("State.watch", "State.supervisor"),
            ("WatchState.rudder", "WatchState.rudder_monitor"),
            ("WatchState.authority", "WatchState.steering_monitor"),
            ("WatchState.block", "WatchState.steering_monitor.block"),
            ("WatchState.turn_square", "WatchState.steering_monitor.turn_square"),
            ("WatchState.blocks", "WatchState.steering_monitor.blocks"),
            ("WatchState.bent_s", "WatchState.hard_over_s"),
            ("WatchState.straightened", "WatchState.kept_amidships"),
            ("AuthorityState.lost", "AuthorityState.unresponsive"),
            ("FailsafeState.known", "FailsafeState.active"),
            ("RudderWatch.anchor_rad", "RudderWatch.progress_rad"),
            ("RudderWatch.anchor_s", "RudderWatch.progress_s"),
            ("RudderWatch.still_rad", "RudderWatch.motion_rad"),
            ("RudderWatch.still_s", "RudderWatch.motion_s"),
            ("RudderWatch.astray", "RudderWatch.deviating"),
            ("RudderWatch.stuck_rad", "RudderWatch.jammed_rad"),
            ("RudderWatch.high_s", "RudderWatch.high_current_s"),
            ("RudderWatch.eased_s", "RudderWatch.relieved_s"),
            ("RestState.since_s", "RestState.steady_since_s"),
            ("RestState.resting_s", "RestState.released_since_s"),
            ("RestState.awake_until_s", "RestState.enabled_until_s"),
            ("Followed.wanted", "Followed.heading_target"),
            ("FollowState.order", "FollowState.task"),
            ("Go.accept_m", "Go.acceptance_radius_m"),
            ("Go.keep_m", "Go.station_radius_m"),
            ("Go.to", "Go.place"),
            ("Keep.keep_m", "Keep.radius_m"),
            ("MissionProgress.halt", "MissionProgress.pause_task"),
            ("MissionProgress.idle", "MissionProgress.idle_items"),
            ("MissionProgress.order", "MissionProgress.task"),
            ("MissionProgress.place", "MissionProgress.line_start"),
            ("NavState.done_s", "NavState.updated_s"),
            ("NavState.follow", "NavState.follower"),
            ("NavState.followed", "NavState.status"),
            ("NavState.order", "NavState.task"),
            ("Reference.push_rad", "Reference.feedforward_rad"),
            ("Resume.order", "Resume.task"),
            ("State.reference", "State.controller.reference"),
        ),
        renamed={
            "Head": "HoldHeading",
            "Go": "GoTo",
            "Keep": "HoldStation",
            "FilterState": "WaveFilterState",
            "Learned": "NoiseModel",
            "CurrentState": "WaterState",
            "StationState": "StationKeepingState",
            "AuthorityState": "SteeringMonitorState",
        },
        converted={"MonitorState": _monitor_by_name, "FailsafeState": _failsafe_by_name},
    ),
    Change(
        3,
        # The filter has other states: it begins anew, with the sea that it had learned.
        moved=(
            ("WaveFilterState.x", None),
            ("WaveFilterState.p", None),
            ("WaveFilterState.sensitivity", None),
            ("NoiseModel.information", None),
            ("StationKeepingState.heading_rad", "StationKeepingState.way_rad"),
            ("State.water.mean", "State.heading_estimator.wave_filter.expected_water"),
            # The steering monitor keeps other sums: it begins anew, with the verdict there was.
            *_given_up("SteeringMonitorState", "block", "turn_square", "blocks", "expected_rad_s"),
            *_given_up("SteeringMonitorState", "expected_square", "product"),
            *_given_up("WaterState", "covariance", "noise", "outliers", "block", "average", "leg"),
        ),
        converted={"SteeringMonitorState": _rudder_unknown},
    ),
    Change(
        4,
        # The filter has a state more: it begins anew, with the sea and the float that it had learned.
        moved=(
            *_given_up("WaveFilterState", "x", "p", "slopes"),
            ("OscillationState.softened_at", None),  # the half swing that softened the helm last
        ),
    ),
    Change(
        5,
        moved=(  # one judge of a lost rudder for two: it begins anew, with the verdict there was
            ("SteeringMonitorState.answer", None),
            ("SteeringMonitorState.unresponsive", "SteeringMonitorState.answer.missing"),
            *_given_up("SteeringMonitorState", "rate_rad_s", "slow_rate_rad_s", "telling_s", "turned_rad"),
            ("SteeringMonitorState.expected_rad", None),
        ),
    ),
    Change(6, moved=_given_up("LastPlace", "utc_s", "boot")),  # how long ago it was is not known then
)


def _parameters_from(data: Any, spot: Spot) -> ParameterSet:
    """Read parameters by name."""
    if not isinstance(data, dict):
        raise ValueError(f"expected parameters by name, found {shown(data)}")  # noqa: TRY004 -- bad data
    parameters = ParameterSet()
    for name, value in data.items():
        if name not in INDEX:
            spot.note(f"parameter {shown(name)} is not known here, ignored")
            continue
        try:
            parameters = parameters.replaced(name, number(value))
        except ParameterError as error:
            spot.note(f"{error}; its default is taken")
        except ValueError as error:
            spot.note(f"{name}: {error}; its default is taken")
    return parameters


PARAMETER_HOOK = Hook(ParameterSet, lambda parameters: dict(parameters.items()), _parameters_from)


def fault_fields(faults: type[IntEnum] = Fault) -> tuple[FieldHook, ...]:
    """Return how the fields that tell of faults travel: by the names of the faults given."""

    def faults_named(names: Iterable[Any], spot: Spot) -> list[Any]:
        members = []
        for name in names:
            if isinstance(name, str) and name in faults.__members__:
                members.append(faults[name])
            else:
                spot.note(f"fault {shown(name)} is not known here, ignored")
        return members

    def times_by_name(times: tuple[float | None, ...]) -> dict[str, float]:
        return {fault.name: time_s for fault in faults if (time_s := times[fault]) is not None}

    def times_from(data: Any, spot: Spot) -> tuple[float | None, ...]:
        if not isinstance(data, dict):
            raise ValueError(f"expected times by fault, found {shown(data)}")  # noqa: TRY004 -- bad data
        times: list[float | None] = [None] * len(faults)
        for fault in faults_named(data, spot):
            value = data[fault.name]
            times[fault] = None if value is None else number(value)
        return tuple(times)

    def bits_by_name(bits: int) -> list[str]:
        return [fault.name for fault in faults if bits >> fault & 1]

    def bits_from(data: Any, spot: Spot) -> int:
        if not isinstance(data, list):
            raise ValueError(f"expected a list of faults, found {shown(data)}")  # noqa: TRY004 -- bad data
        return sum(1 << fault for fault in set(faults_named(data, spot)))

    def fault_from(data: Any, spot: Spot) -> IntEnum | None:
        members = [] if data is None else faults_named([data], spot)
        return members[0] if members else None

    return (
        FieldHook(LatchState, "since_s", times_by_name, times_from),
        FieldHook(LatchState, "stood_s", times_by_name, times_from),
        FieldHook(LatchState, "active", bits_by_name, bits_from),
        FieldHook(FailsafeState, "active", bits_by_name, bits_from),
        FieldHook(FailsafeState, "calling", bits_by_name, bits_from),
        FieldHook(FailsafeState, "fault", lambda fault: None if fault is None else faults(fault).name, fault_from),
    )


def _bytes_from(data: Any, _spot: Spot) -> bytes:
    if not isinstance(data, str):
        raise ValueError(f"expected base64, found {shown(data)}")  # noqa: TRY004 -- bad data
    return base64.b64decode(data, validate=True)


BYTES_HOOK = Hook(bytes, lambda numbers: base64.b64encode(numbers).decode("ascii"), _bytes_from)
_CODEC = Codec([State], [PARAMETER_HOOK, PLAN_HOOK, BYTES_HOOK], fault_fields(), CHANGES)


def state_to_text(state: State) -> str:
    """Write a state as one line of text."""
    return _CODEC.to_text(state)


def state_from_text(text: str) -> tuple[State, tuple[str, ...]]:
    """Read a state of any version, and what is to be said of it; ValueError for text that is no state."""
    state, notes = _CODEC.read(text)
    return state, notes
