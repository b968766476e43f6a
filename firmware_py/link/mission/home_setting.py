"""SET_HOME_POSITION, the message that stations used before the command."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.peer import Peer
from firmware_py.link.telemetry.geo import home_of
from firmware_py.link.wire.dialect import Message


class HomeSetting:
    """Sets home; what has come of it is told by HOME_POSITION."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask through."""
        self._context = context

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {243: self._set}

    def _set(self, peer: Peer, message: Message, now_s: float) -> None:
        """Set home to a position."""
        home = home_of(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)
        self._context.request_or_warn(peer, message, home, now_s)
