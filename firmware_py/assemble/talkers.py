"""Wires the outputs of NMEA 0183: opened with the links, fed after each tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from typing import TYPE_CHECKING

from firmware_py.common.angles import radians
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.link_status import LinkStatus
from firmware_py.common.reports import Output
from firmware_py.core.state import State, parameters_in_force
from firmware_py.link.endpoint import Endpoint
from firmware_py.link.wire.open_transport import NMEA
from firmware_py.loop import LoopParts

if TYPE_CHECKING:
    from firmware_py.link.nmea import NmeaOutput


def open_talkers(
    urls: Sequence[str],
    open_line: Callable[[str, int], ByteLine],
    say: Callable[[str], None] | None,
    opened: ExitStack,
) -> list[NmeaOutput]:
    """Open the outputs among the links, or raise LinkError; nothing is loaded without one."""
    wanted = [url for url in urls if url.startswith(NMEA)]
    if not wanted:
        return []
    from firmware_py.link.nmea import open_output  # noqa: PLC0415 - who has none pays nothing

    talkers = []
    for url in wanted:
        talkers.append(open_output(url, open_line, say))
        opened.callback(talkers[-1].close)
    return talkers


def links_of(endpoint: Endpoint, talkers: Sequence[NmeaOutput]) -> Callable[[float], Sequence[LinkStatus]]:
    """Return what tells how links and outputs fare."""
    return lambda now_s: (*endpoint.status(now_s), *(talker.status(now_s) for talker in talkers))


def feed_talkers(talkers: Sequence[NmeaOutput], parts: LoopParts) -> None:
    """Have each tick told to the outputs; what goes wrong there is told and is no concern of the loop."""
    if not talkers:
        return
    from firmware_py.link.nmea import Scene  # noqa: PLC0415 - it is there by now

    show_status = parts.show_status

    def after_tick(output: Output, now_s: float) -> None:
        def scene() -> Scene:
            return Scene(output.snapshot, parts.clock.utc_s(), declination_rad(parts.autopilot.state))

        for talker in talkers:
            parts.fault_barrier.call(now_s, partial(talker.publish, scene, now_s))
        show_status(output, now_s)

    parts.show_status = after_tick


def declination_rad(state: State) -> float:
    """Return the declination in force: the model's where it is chosen and known, else the parameter's."""
    parameters = parameters_in_force(state)
    by_model = state.heading_estimator.declination.declination_rad if parameters["CMP_DECL_AUTO"] == 1 else None
    return radians(parameters["CMP_DECL_DEG"]) if by_model is None else by_model
