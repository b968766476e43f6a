"""The table of measurements."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from hil.bench import (
    first_use,
    hour,
    lateness,
    load,
    lockstep,
    objective,
    replay,
    sense,
    start,
    swarm,
    transfers,
    trips,
    twin,
    work,
)
from hil.bench.figure import Finding
from hil.bench.setting import Setting


class Measurement(NamedTuple):
    """One measurement and what it tells, in a few words."""

    text: str
    measure: Callable[[Setting], Finding]


TABLE: Mapping[str, Measurement] = {
    "lateness": Measurement("how late the ticks begin, at 10 and 50 Hz", lateness.measure),
    "sense": Measurement("from a compass sentence to the servo frame", sense.measure),
    "replay": Measurement("an onboard log recomputed", replay.measure),
    "work": Measurement("how much Python a tick executes", work.measure),
    "load": Measurement("processor time and memory at 10 Hz", load.measure),
    "start": Measurement("from exec to the first rudder frame", start.measure),
    "lockstep": Measurement("how many times real time she sails in lockstep", lockstep.measure),
    "trips": Measurement("PARAM_SET and COMMAND_LONG round trips", trips.measure),
    "transfers": Measurement("parameters, missions and logs over a link", transfers.measure),
    "objective": Measurement("the identification's objective beside C", objective.measure),
    "hour": Measurement("an hour's log identified", hour.measure),
    "swarm": Measurement("the fish swarm beside scikit-opt's", swarm.measure),
    "twin": Measurement("the compiled twin beside its bare arithmetic", twin.measure),
    "first-use": Measurement("the first use on a machine, which compiles", first_use.measure),
}
