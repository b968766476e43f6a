"""Who may read the page: requests as a browser of the same page makes them, and with the token where one is needed.

A page on the loopback is not only its user's: any site that a browser shows may send requests there, under the name
of a host of its own that resolves to 127.0.0.1 (DNS rebinding). Such a request names that host, which is none of ours.
"""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Mapping
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Final
from urllib.parse import parse_qs

import msgspec

from firmware_py.files.reading import read_regular

COOKIE: Final = "rambler_view"
LEAST_TOKEN, MOST_TOKEN = 16, 256
_MOST_TARGET: Final = 1024


class ViewError(Exception):
    """The page cannot be shown; the text is one line that names the remedy."""


DEFAULT_LISTEN: Final = "127.0.0.1:8046"


def listen_address(listen: str, *, with_token: bool) -> tuple[str, int, bool]:
    """Return host, port and whether that is this computer alone; ViewError for what is none, or wants a token."""
    host, colon, port_text = listen.rpartition(":")
    host = "127.0.0.1" if host == "localhost" else host.strip("[]")
    try:
        loopback, port = ipaddress.ip_address(host).is_loopback, int(port_text)
    except ValueError:
        colon = ""
    if not colon or not 0 <= port <= 0xFFFF:
        raise ViewError(f"{listen[:60]}: write ADDRESS:PORT, as in {DEFAULT_LISTEN} or 0.0.0.0:8046")
    if not loopback and not with_token:
        raise ViewError(f"{listen}: beyond this computer the page asks for a token; name the file that holds it")
    return host, port, loopback


class Verdict(msgspec.Struct, frozen=True):
    """What is answered to a request: an HTTP status, the path that is meant, the token to be remembered."""

    status: int
    path: str = ""
    text: str = ""
    remember: bool = False


class Guard(msgspec.Struct, frozen=True):
    """Judges requests; `token` is empty on the loopback, `names` are the computer's own beside localhost."""

    token: str
    loopback: bool
    names: frozenset[str] = frozenset()

    def judge(self, method: str, target: str, headers: Mapping[str, str]) -> Verdict:
        """Return what is to be done with a request."""
        if method not in ("GET", "HEAD"):
            return Verdict(405, text="this page is to be read only")
        host = headers.get("Host") or ""
        if not self._is_ours(host):
            return Verdict(421, text="ask by the address that the page was told with, not by another name")
        origin, site = headers.get("Origin"), headers.get("Sec-Fetch-Site", "none")
        if origin is not None and origin != f"http://{host}":
            return Verdict(403, text="another page may not ask")
        # Following a link from elsewhere is a person's doing; fetching from elsewhere is a page's.
        if site not in ("none", "same-origin") and headers.get("Sec-Fetch-Mode") != "navigate":
            return Verdict(403, text="another page may not ask")
        if len(target) > _MOST_TARGET:
            return Verdict(414, text="that is no address of this page")
        path, _, query = target.partition("?")
        if self.token and not self._knows(_cookie(headers.get("Cookie", ""))):
            if path == "/" and self._knows("".join(parse_qs(query).get("token", ()))):
                return Verdict(303, "/", remember=True)
            return Verdict(403, text="the token is missing or wrong: open /?token=... with what is in the token file")
        return Verdict(200, path)

    def _is_ours(self, host: str) -> bool:
        name = host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() else host
        name = name.strip("[]").lower()
        if name in ("localhost", *self.names):
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return address.is_loopback or not self.loopback

    def _knows(self, word: str) -> bool:
        return hmac.compare_digest(word.encode("utf-8", "replace"), self.token.encode())


def _cookie(text: str) -> str:
    try:
        morsel = SimpleCookie(text).get(COOKIE)
    except CookieError:
        return ""
    return "" if morsel is None else morsel.value


def read_token(path: Path) -> str:
    """Return the token of a file that others cannot read; ViewError names the remedy."""
    try:
        if path.stat().st_mode & 0o007:
            raise ViewError(f"token file {path}: everybody may read it; chmod 600 {path}")
        token = read_regular(path, 1 << 12).decode("ascii").strip()
    except OSError as error:
        raise ViewError(f"token file {path}: {error.strerror}; make one: openssl rand -hex 16 > {path}") from None
    except ValueError:
        token = ""
    if not (LEAST_TOKEN <= len(token) <= MOST_TOKEN and token.isalnum()):
        raise ViewError(
            f"token file {path}: give {LEAST_TOKEN} to {MOST_TOKEN} letters and digits: openssl rand -hex 16 > {path}"
        )
    return token
