"""What the devices have last reported of themselves: storage, clock, ground stations, compasses."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_py.common.records import DeviceHealth, DeviceRole, Inputs


@dataclass(frozen=True, slots=True)
class DeviceReports:
    """The newest health of storage, clock and ground stations, and when compass A and B last gave a heading."""

    storage: DeviceHealth | None = None
    clock: DeviceHealth | None = None
    link: DeviceHealth | None = None
    compass_s: tuple[float | None, float | None] = (None, None)


def update(state: DeviceReports, inputs: Inputs) -> DeviceReports:
    """Take the reports and headings of a tick in."""
    if not inputs.headings and not inputs.devices:
        return state
    storage, clock, link = state.storage, state.clock, state.link
    for device in inputs.devices:
        storage = device if device.role is DeviceRole.STORAGE else storage
        clock = device if device.role is DeviceRole.CLOCK else clock
        link = device if device.role is DeviceRole.LINK else link
    a_s, b_s = state.compass_s
    for sample in inputs.headings:
        if sample.source == 0:
            a_s = sample.t_s
        else:
            b_s = sample.t_s
    return DeviceReports(storage, clock, link, (a_s, b_s))
