"""Log download: none yet; an empty list, so that ground stations do not wait."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.link.dialect import Message, mavlink
from firmware_py.link.peer import Peer
from firmware_py.link.session import Handler, Session


class Logs:
    """Answers LOG_REQUEST_LIST."""

    def __init__(self, session: Session) -> None:
        """Take the session to answer through."""
        self._session = session

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {117: self._list}

    def _list(self, peer: Peer, message: Message, now_s: float) -> None:  # noqa: ARG002 - a handler like the others
        self._session.send(peer, mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))
