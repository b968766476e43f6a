"""BATTERY_STATUS of another component of the boat, where PWR_COMPANION says that it is to be believed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from firmware_py.common.intents import ReportBattery
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.peer import Peer
from firmware_py.link.telemetry.context_fields import INT16_MAX, UINT16_MAX
from firmware_py.link.wire.dialect import Message

BATTERY_STATUS = 147
INTERVAL_S = 0.5  # what comes oftener is not looked at


class Companion:
    """Takes the first battery of the component that was chosen; what others say of theirs is left alone."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask and to answer through."""
        self._context = context
        self._taken_s = -math.inf

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {BATTERY_STATUS: self._battery}

    def _battery(self, peer: Peer, message: Message, now_s: float) -> None:
        """Take voltage, current and charge of the battery from the component PWR_COMPANION."""
        if message.id != 0 or not is_chosen(self._context, message) or now_s - self._taken_s < INTERVAL_S:
            return
        self._taken_s = now_s
        self._context.request_or_warn(peer, message, reported(message), now_s)


def is_chosen(context: LinkContext, message: Message) -> bool:
    """Return whether the sender of a message is the component of the boat that is believed about the battery."""
    chosen = int(context.request_handler.parameters()["PWR_COMPANION"])
    return chosen != 0 and (message.get_srcSystem(), message.get_srcComponent()) == (context.system, chosen)


def reported(message: Message) -> ReportBattery:
    """Return what a BATTERY_STATUS says; a current out of the battery is positive in it."""
    millivolts = _known(message.voltages, UINT16_MAX) + _known(message.voltages_ext, 0)
    centiamperes, percent = message.current_battery, message.battery_remaining
    return ReportBattery(
        voltage_v=sum(millivolts) * 1e-3 if millivolts else None,
        current_a=None if centiamperes == -1 else -0.01 * centiamperes,
        charge=None if percent < 0 else 0.01 * percent,
        temperature_c=None if message.temperature == INT16_MAX else 0.01 * message.temperature,
    )


def _known(cells: Sequence[int], unknown: int) -> list[int]:
    return [cell for cell in cells if cell != unknown]
