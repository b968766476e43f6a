"""Outputs of NMEA 0183: opens them with the links, and sends data after each tick."""

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
from firmware_py.link.wire.open_transport import NMEA_PREFIX
from firmware_py.loop import LoopParts

if TYPE_CHECKING:
    from firmware_py.link.nmea import NmeaOutput


def open_nmea_outputs(
    urls: Sequence[str],
    open_line: Callable[[str, int], ByteLine],
    say: Callable[[str], None] | None,
    opened: ExitStack,
) -> list[NmeaOutput]:
    """Open the NMEA outputs among the links, or raise LinkError; without one, their module is not imported."""
    nmea_urls = [url for url in urls if url.startswith(NMEA_PREFIX)]
    if not nmea_urls:
        return []
    from firmware_py.link.nmea import open_output  # noqa: PLC0415 - rarely used

    outputs = []
    for url in nmea_urls:
        outputs.append(open_output(url, open_line, say))
        opened.callback(outputs[-1].close)
    return outputs


def status_reader(endpoint: Endpoint, outputs: Sequence[NmeaOutput]) -> Callable[[float], Sequence[LinkStatus]]:
    """Return a function that returns the status of links and outputs at a time."""
    return lambda now_s: (*endpoint.status(now_s), *(nmea_output.status(now_s) for nmea_output in outputs))


def connect_nmea_outputs(outputs: Sequence[NmeaOutput], parts: LoopParts) -> None:
    """Send each tick to the outputs; their errors are reported and do not affect the loop."""
    if not outputs:
        return
    from firmware_py.link.nmea import NmeaData  # noqa: PLC0415 - already loaded

    next_after_tick = parts.after_tick

    def after_tick(output: Output, now_s: float) -> None:
        def create_data() -> NmeaData:
            return NmeaData(output.snapshot, parts.clock.utc_s(), declination_rad(parts.autopilot.state))

        for nmea_output in outputs:
            parts.fault_barrier.call(now_s, partial(nmea_output.publish, create_data, now_s))
        next_after_tick(output, now_s)

    parts.after_tick = after_tick


def declination_rad(state: State) -> float:
    """Return the declination, positive to the east: by the model if selected and known, else by the parameter."""
    parameters = parameters_in_force(state)
    by_model = state.heading_estimator.declination.declination_rad if parameters["CMP_DECL_AUTO"] == 1 else None
    return radians(parameters["CMP_DECL_DEG"]) if by_model is None else by_model
