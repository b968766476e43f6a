"""SETUP_SIGNING: a key is set and removed over a trusted link only, and told to nobody."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.common.interfaces import Vault
from firmware_py.common.records import Severity
from firmware_py.link.context import Handler, LinkContext
from firmware_py.link.peer import Peer
from firmware_py.link.security.access import SETUP_SIGNING
from firmware_py.link.security.signing import Signing
from firmware_py.link.wire.dialect import Message

_UNTRUSTED = "SETUP_SIGNING refused: set the key by `rambler key set`, or over a link with ?trusted=1 in its URL"


class KeySetup:
    """Sets the key that frames are signed with, or removes it (a key of zeros and a timestamp of zero)."""

    def __init__(self, context: LinkContext, signing: Signing, vault: Vault) -> None:
        """Take the context to answer through, what holds the key, and where that is kept."""
        self._context = context
        self._signing = signing
        self._vault = vault

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {SETUP_SIGNING: self._set}

    def _set(self, peer: Peer, message: Message, now_s: float) -> None:
        if not peer.transport.options.trusted:
            self._context.send_text_limited(peer, Severity.WARNING, _UNTRUSTED, now_s)
            return
        key, timestamp = bytes(message.secret_key), message.initial_timestamp
        if not any(key) and timestamp == 0:
            self._signing.remove_key()
            done = "Signing key removed"
        elif self._signing.set_key(key, timestamp):
            done = "Signing key set"
        else:
            self._context.send_text_limited(
                peer, Severity.WARNING, "SETUP_SIGNING refused: no key, or no timestamp", now_s
            )
            return
        self._vault.when_stored(lambda stored: self._stored(done, stored=stored))

    def _stored(self, done: str, *, stored: bool) -> None:
        if stored:
            self._context.send_text_all(Severity.NOTICE, done)
        else:
            self._context.send_text_all(Severity.ERROR, f"{done}, but this could not be stored")
        self._context.flush_all()
