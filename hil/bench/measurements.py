"""The table of measurements."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from hil.bench import latency, process, tick, tools, transfers
from hil.bench.figure import Finding
from hil.bench.setting import Setting


class Measurement(NamedTuple):
    """One measurement and its description."""

    text: str
    measure: Callable[[Setting], Finding]


TABLE: Mapping[str, Measurement] = {
    "sense": Measurement("latency from a compass sentence to the servo frame", latency.sense),
    "replay": Measurement("processor time of a tick in rambler replay", tick.replay),
    "work": Measurement("Python instructions of a tick", tick.work),
    "load": Measurement("processor time and memory at 10 Hz", process.load),
    "start": Measurement("time from exec to the first rudder frame", process.start),
    "lockstep": Measurement("speed of a run in lockstep", process.lockstep),
    "transfers": Measurement("parameters and missions over a link", transfers.measure),
    "hour": Measurement("identification of an hour's log", tools.hour),
    "swarm": Measurement("an evaluation of the fish swarm", tools.swarm),
    "twin": Measurement("a control tick of the compiled loop", tools.loop),
}
