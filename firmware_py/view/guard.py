"""Access control of the live page: only same-origin requests, and only with a token unless on the loopback address.

A web site can make a browser send requests to the loopback address under the host name of the site (DNS rebinding).
Such requests are recognized by their Host header.
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
MIN_TOKEN_CHARACTERS, MAX_TOKEN_CHARACTERS = 16, 256
_MAX_TARGET_CHARACTERS: Final = 1024
DEFAULT_LISTEN: Final = "127.0.0.1:8046"


class ViewError(Exception):
    """The page cannot be served; the text names the remedy in one line."""


def parse_listen_address(listen: str, *, with_token: bool) -> tuple[str, int, bool]:
    """Parse an address; return host, port, and whether it is a loopback address.

    Raises ViewError if the address is invalid, or not a loopback address and without a token.
    """
    host, _, port_text = listen.rpartition(":")
    host = "127.0.0.1" if host == "localhost" else host.strip("[]")
    try:
        is_loopback, port = ipaddress.ip_address(host).is_loopback, int(port_text)
    except ValueError:
        is_loopback, port = False, -1
    if not 0 <= port <= 0xFFFF:
        raise ViewError(f"{listen[:60]}: not an address; use ADDRESS:PORT, such as {DEFAULT_LISTEN} or 0.0.0.0:8046")
    if not is_loopback and not with_token:
        raise ViewError(f"{listen}: access from other computers needs a token; give its file")
    return host, port, is_loopback


class Verdict(msgspec.Struct, frozen=True):
    """Result of the check of a request: HTTP status, path, error text, and whether to set the cookie."""

    status: int
    path: str = ""
    text: str = ""
    sets_cookie: bool = False


class Guard(msgspec.Struct, frozen=True):
    """Checks requests; `token` is empty if none is needed, `names` are host names in addition to localhost."""

    token: str
    is_loopback: bool
    names: frozenset[str] = frozenset()

    def check(self, method: str, target: str, headers: Mapping[str, str]) -> Verdict:
        """Check a request."""
        if method not in ("GET", "HEAD"):
            return Verdict(405, text="method not allowed; use GET")
        host = headers.get("Host") or ""
        if not self._is_own_host(host):
            return Verdict(421, text="unknown host name; use the address that rambler view has printed")
        origin, site = headers.get("Origin"), headers.get("Sec-Fetch-Site", "none")
        if origin is not None and origin != f"http://{host}":
            return Verdict(403, text="cross-site request refused")
        # A user may follow a link from another site; scripts of another site may not send requests.
        if site not in ("none", "same-origin") and headers.get("Sec-Fetch-Mode") != "navigate":
            return Verdict(403, text="cross-site request refused")
        if len(target) > _MAX_TARGET_CHARACTERS:
            return Verdict(414, text="address too long")
        path, _, query = target.partition("?")
        if self.token and not self._is_valid_token(_token_from_cookie(headers.get("Cookie", ""))):
            if path == "/" and self._is_valid_token("".join(parse_qs(query).get("token", ()))):
                return Verdict(303, "/", sets_cookie=True)
            return Verdict(403, text="token missing or wrong; open /?token=... with the content of the token file")
        return Verdict(200, path)

    def _is_own_host(self, host: str) -> bool:
        name = host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() else host
        name = name.strip("[]").lower()
        if name in ("localhost", *self.names):
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return address.is_loopback or not self.is_loopback

    def _is_valid_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode("utf-8", "replace"), self.token.encode())


def _token_from_cookie(text: str) -> str:
    try:
        morsel = SimpleCookie(text).get(COOKIE)
    except CookieError:
        return ""
    return "" if morsel is None else morsel.value


def read_token(path: Path) -> str:
    """Read the token from a file; raise ViewError if other users can read the file or the token is invalid."""
    try:
        if path.stat().st_mode & 0o007:
            raise ViewError(f"token file {path}: readable by other users; chmod 600 {path}")
        token = read_regular(path, 1 << 12).decode("ascii").strip()
    except OSError as error:
        raise ViewError(f"token file {path}: {error.strerror}; create it: openssl rand -hex 16 > {path}") from None
    except ValueError:
        token = ""
    if not (MIN_TOKEN_CHARACTERS <= len(token) <= MAX_TOKEN_CHARACTERS and token.isalnum()):
        raise ViewError(
            f"token file {path}: needs {MIN_TOKEN_CHARACTERS} to {MAX_TOKEN_CHARACTERS} letters and digits; "
            f"openssl rand -hex 16 > {path}"
        )
    return token
