"""Serves the page under way and tells its readers what is new: bounded in all that others can ask for.

It runs in a process of its own, which knows the autopilot by a file alone: whatever is asked, no tick waits for it.
"""

from __future__ import annotations

import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final, cast

from firmware_py.view.document import LIVE, document, policy
from firmware_py.view.guard import COOKIE, Guard, ViewError

MOST_CONNECTIONS: Final = 32
MOST_READERS: Final = 24  # of them, that stay
PATIENCE_S: Final = 10.0  # with who asks, and with who reads
KEPT: Final = 64  # messages: who is farther behind is told all anew
ALIVE_S: Final = 15.0  # at least so often something is sent, so that who is gone is noticed
_BODY: Final = '<div id="live"></div><noscript><p>This page needs a browser that runs scripts.</p></noscript>'


class Hub:
    """Hands out what is new; readers that are slow lose messages, never the one who writes time."""

    def __init__(self, whole: Callable[[], bytes]) -> None:
        """`whole` returns all that there is; it is called with the lock held."""
        self._whole = whole
        self._condition = threading.Condition()
        self._kept: deque[tuple[int, int, bytes]] = deque(maxlen=KEPT)
        self._number = self._epoch = 0
        self.closed = self.over = False

    def publish(self, work: Callable[[], tuple[bytes | None, int]]) -> None:
        """Do the work, which returns a message and the epoch, while nobody reads, and wake the readers."""
        with self._condition:
            message, epoch = work()
            if message is None:
                return
            self._number += 1
            self._epoch = epoch
            self._kept.append((self._number, epoch, message))
            self._condition.notify_all()

    def close(self, *, over: bool) -> None:
        """Send the readers away; unless all is over they come back when somebody serves here again."""
        with self._condition:
            self.closed, self.over = True, over
            self._condition.notify_all()

    def next(self, after: tuple[int, int] | None) -> tuple[tuple[int, int], list[tuple[str, bytes]]]:
        """Return where a reader is then, and the kinds and contents of what is new since, all of it to a new one."""
        with self._condition:
            if after is not None:
                self._condition.wait_for(lambda: self.closed or self._number > after[0], ALIVE_S)
            here = (self._number, self._epoch)
            oldest = self._kept[0][0] if self._kept else self._number + 1
            if after is None or after[1] != self._epoch or after[0] + 1 < oldest <= self._number:
                return here, [("whole", self._whole())]
            return here, [("new", message) for number, _, message in self._kept if number > after[0]]


class ViewServer(ThreadingHTTPServer):
    """Listens on one address; ViewError when it cannot be had."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = 16

    def __init__(self, address: tuple[str, int], guard: Guard, hub: Hub) -> None:
        """Open the port."""
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self.guard, self.hub = guard, hub
        self.readers = threading.BoundedSemaphore(MOST_READERS)
        self._connections = threading.BoundedSemaphore(MOST_CONNECTIONS)
        self._asking: dict[Any, float] = {}  # since when; who asks slowly for ever is sent away
        title = "Rambler under way"
        self.page = document(title, [_BODY], LIVE, connect=True).encode()
        self.policy = policy(LIVE, connect=True) + "; frame-ancestors 'none'"
        try:
            super().__init__(address, _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise ViewError(f"{address[0]}:{address[1]}: {reason}; give another --listen HOST:PORT") from None

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread of its own, if there is room for one."""
        if not self._connections.acquire(blocking=False):
            self.shutdown_request(request)
            return
        self._asking[request] = time.monotonic()
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, and make room again."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._asking.pop(request, None)
            self._connections.release()

    def has_asked(self, request: Any) -> None:
        """Note that a request is there."""
        self._asking.pop(request, None)

    def service_actions(self) -> None:
        """Send away who has not come to the end of a request in time."""
        late_s = time.monotonic() - PATIENCE_S
        for request, since_s in list(self._asking.items()):
            if since_s < late_s:
                self._asking.pop(request, None)
                try:
                    request.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass  # it has gone by itself

    def handle_error(self, _request: Any, client_address: Any) -> None:
        """Say nothing of who goes away in the middle."""
        error = sys.exc_info()[1]
        if not isinstance(error, OSError):
            sys.stderr.write(f"rambler view: {client_address}: {error!r}\n")


class _Handler(BaseHTTPRequestHandler):
    timeout = PATIENCE_S

    def parse_request(self) -> bool:
        """Read a request and judge it; what is not allowed is answered here."""
        if not super().parse_request():
            return False
        server = cast("ViewServer", self.server)
        server.has_asked(self.connection)
        # Names as the guard knows them, however they are written; one that comes twice is neither.
        headers = {name.title(): ", ".join(self.headers.get_all(name, ())) for name in self.headers}
        verdict = server.guard.judge(self.command, self.path, headers)
        if verdict.status == 303:
            cookie = f"{COOKIE}={server.guard.token}; HttpOnly; SameSite=Lax; Path=/"
            self._answer(303, b"", {"Location": "/", "Set-Cookie": cookie})
        elif verdict.status != 200:
            self._answer(verdict.status, (verdict.text + "\n").encode(), {"Content-Type": "text/plain; charset=utf-8"})
        elif verdict.path == "/":
            self._answer(200, server.page, {"Content-Type": "text/html; charset=utf-8"})
        elif verdict.path == "/events" and self.command == "GET":
            self._tell(server)
        else:
            self._answer(404, b"there is nothing\n", {"Content-Type": "text/plain; charset=utf-8"})
        return False

    def _tell(self, server: ViewServer) -> None:
        """Send what is new as it comes, until the reader goes or is too slow."""
        if not server.readers.acquire(blocking=False):
            self._answer(503, b"too many readers\n", {"Content-Type": "text/plain; charset=utf-8", "Retry-After": "30"})
            return
        try:
            self._begin(200, {"Content-Type": "text/event-stream; charset=utf-8"})
            here = None
            while not server.hub.closed:
                here, news = server.hub.next(here)
                parts = [b"event: " + kind.encode() + b"\ndata: " + content + b"\n\n" for kind, content in news]
                self.wfile.write(b"".join(parts) or b": still here\n\n")
            if server.hub.over:
                self.wfile.write(b"event: end\ndata: {}\n\n")
        except OSError:
            pass  # gone, or too slow
        finally:
            server.readers.release()

    def _answer(self, status: int, body: bytes, headers: dict[str, str]) -> None:
        try:
            self._begin(status, {**headers, "Content-Length": str(len(body))})
            if self.command != "HEAD":
                self.wfile.write(body)
        except OSError:
            pass  # gone

    def _begin(self, status: int, headers: dict[str, str]) -> None:
        server = cast("ViewServer", self.server)
        self.send_response(status)
        for name, value in {
            **headers,
            "Content-Security-Policy": server.policy,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cache-Control": "no-store",
            "Connection": "close",
        }.items():
            self.send_header(name, value)
        self.end_headers()
        self.close_connection = True

    def version_string(self) -> str:
        """Tell no version to everybody."""
        return "rambler"

    def log_message(self, *_words: object) -> None:
        """Write nothing: who asks does not fill a disk."""
