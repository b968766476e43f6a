"""The operator's stick: MANUAL_CONTROL and RC_CHANNELS_OVERRIDE."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.common.intents import ManualRudder
from firmware_py.link.context import Handler, LinkContext, within
from firmware_py.link.peer import Peer
from firmware_py.link.telemetry.context_fields import INT16_MAX, UINT16_MAX
from firmware_py.link.wire.dialect import Message

_FULL_STICK = 1000
_CENTRE_US, _FULL_US = 1500, 500
_RELEASE, _IGNORE = 0, UINT16_MAX


class ManualControl:
    """Turns stick messages into rudder deflections."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask and to answer through."""
        self._context = context

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {69: self._stick, 70: self._override}

    def _stick(self, peer: Peer, message: Message, now_s: float) -> None:
        """Take the roll axis y, or the yaw axis r where y is said to be invalid."""
        axis = message.r if message.y == INT16_MAX else message.y
        if axis == INT16_MAX:
            return
        valid = within(axis, -_FULL_STICK, _FULL_STICK)
        intent = ManualRudder(axis / _FULL_STICK) if valid else "the stick is not within -1000 to 1000"
        self._context.request_or_warn(peer, message, intent, now_s)

    def _override(self, peer: Peer, message: Message, now_s: float) -> None:
        """Take channel 1: 1000 to 2000 us, 0 releases it."""
        pulse_us = message.chan1_raw
        if pulse_us == _IGNORE:
            return
        intent: ManualRudder | str = ManualRudder(None)
        if pulse_us != _RELEASE:
            valid = within(pulse_us, _CENTRE_US - _FULL_US, _CENTRE_US + _FULL_US)
            deflection = (pulse_us - _CENTRE_US) / _FULL_US
            intent = ManualRudder(deflection) if valid else "channel 1 is not within 1000 to 2000"
        self._context.request_or_warn(peer, message, intent, now_s)
