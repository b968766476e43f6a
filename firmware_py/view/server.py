"""Serves the live page and streams updates to its readers, with limited resources.

The server is a separate process and reads only files, so that requests cannot delay the control loop.
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

MAX_CONNECTIONS: Final = 32
MAX_READERS: Final = 24  # connections that receive updates
TIMEOUT_S: Final = 10.0  # for receiving a request and for sending
MAX_BACKLOG: Final = 64  # in messages; a reader that is later receives all data again
KEEPALIVE_S: Final = 15.0  # maximum interval of messages, so that closed connections are detected
_BODY: Final = '<div id="live"></div><noscript><p>This page needs JavaScript.</p></noscript>'


class Hub:
    """Distributes updates to readers; slow readers lose messages and do not delay the writer."""

    def __init__(self, read_all: Callable[[], bytes]) -> None:
        """Store the function that returns all data; it is called with the lock held."""
        self._read_all = read_all
        self._condition = threading.Condition()
        self._backlog: deque[tuple[int, int, bytes]] = deque(maxlen=MAX_BACKLOG)
        self._number = self._epoch = 0
        self.is_closed = self.is_over = False

    def publish(self, read_message: Callable[[], tuple[bytes | None, int]]) -> None:
        """Call a function that returns a message (or None) and the epoch, with the lock held; wake the readers."""
        with self._condition:
            message, epoch = read_message()
            if message is None:
                return
            self._number += 1
            self._epoch = epoch
            self._backlog.append((self._number, epoch, message))
            self._condition.notify_all()

    def close(self, *, is_over: bool) -> None:
        """Disconnect the readers; with `is_over` they do not reconnect when the page is served again."""
        with self._condition:
            self.is_closed, self.is_over = True, is_over
            self._condition.notify_all()

    def next(self, after: tuple[int, int] | None) -> tuple[tuple[int, int], list[tuple[str, bytes]]]:
        """Wait for updates; return the new position of a reader, and kind and content of each update.

        `after` is the last position, None for a new reader, which receives all data.
        """
        with self._condition:
            if after is not None:
                self._condition.wait_for(lambda: self.is_closed or self._number > after[0], KEEPALIVE_S)
            position = (self._number, self._epoch)
            if after is None or after[1] != self._epoch or after[0] < self._number - len(self._backlog):
                return position, [("whole", self._read_all())]
            return position, [("new", message) for number, _, message in self._backlog if number > after[0]]


class ViewServer(ThreadingHTTPServer):
    """HTTP server of the live page at one address."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = 16

    def __init__(self, address: tuple[str, int], guard: Guard, hub: Hub) -> None:
        """Open the port; raises ViewError if that is impossible."""
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self.guard, self.hub = guard, hub
        self.readers = threading.BoundedSemaphore(MAX_READERS)
        self._connections = threading.BoundedSemaphore(MAX_CONNECTIONS)
        self._pending: dict[Any, float] = {}  # start time by request that is not completely received
        title = "Rambler live page"
        self.page = document(title, [_BODY], LIVE, connect=True).encode()
        self.policy = policy(LIVE, connect=True) + "; frame-ancestors 'none'"
        try:
            super().__init__(address, _Handler)
        except OSError as error:
            raise ViewError(f"{address[0]}:{address[1]}: {error.strerror}; use another --listen HOST:PORT") from None

    def process_request(self, request: Any, client_address: Any) -> None:
        """Handle a request in its own thread, up to the connection limit."""
        if not self._connections.acquire(blocking=False):
            self.shutdown_request(request)
            return
        self._pending[request] = time.monotonic()
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Handle a request and release the connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._pending.pop(request, None)
            self._connections.release()

    def mark_received(self, request: Any) -> None:
        """Mark a request as completely received."""
        self._pending.pop(request, None)

    def service_actions(self) -> None:
        """Close connections whose request is not complete in time."""
        oldest_start_s = time.monotonic() - TIMEOUT_S
        for request, start_s in list(self._pending.items()):
            if start_s < oldest_start_s:
                self._pending.pop(request, None)
                try:
                    request.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass  # already closed

    def handle_error(self, _request: Any, client_address: Any) -> None:
        """Print an error, except one of a closed connection."""
        error = sys.exc_info()[1]
        if not isinstance(error, OSError):
            sys.stderr.write(f"rambler view: {client_address}: {error!r}\n")


class _Handler(BaseHTTPRequestHandler):
    timeout = TIMEOUT_S

    def parse_request(self) -> bool:
        """Read and check a request, and reply."""
        if not super().parse_request():
            return False
        server = cast("ViewServer", self.server)
        server.mark_received(self.connection)
        # Repeated headers are joined, so that they match no valid value.
        headers = {name.title(): ", ".join(self.headers.get_all(name, ())) for name in self.headers}
        verdict = server.guard.check(self.command, self.path, headers)
        if verdict.status == 303:
            cookie = f"{COOKIE}={server.guard.token}; HttpOnly; SameSite=Lax; Path=/"
            self._reply(303, b"", {"Location": "/", "Set-Cookie": cookie})
        elif verdict.status != 200:
            self._reply(verdict.status, (verdict.text + "\n").encode(), {"Content-Type": "text/plain; charset=utf-8"})
        elif verdict.path == "/":
            self._reply(200, server.page, {"Content-Type": "text/html; charset=utf-8"})
        elif verdict.path == "/events" and self.command == "GET":
            self._stream(server)
        else:
            self._reply(404, b"not found\n", {"Content-Type": "text/plain; charset=utf-8"})
        return False

    def _stream(self, server: ViewServer) -> None:
        """Send updates until the reader disconnects or is too slow."""
        if not server.readers.acquire(blocking=False):
            self._reply(503, b"too many readers\n", {"Content-Type": "text/plain; charset=utf-8", "Retry-After": "30"})
            return
        try:
            self._send_headers(200, {"Content-Type": "text/event-stream; charset=utf-8"})
            position = None
            while not server.hub.is_closed:
                position, updates = server.hub.next(position)
                events = [b"event: " + kind.encode() + b"\ndata: " + content + b"\n\n" for kind, content in updates]
                self.wfile.write(b"".join(events) or b": keep-alive\n\n")
            if server.hub.is_over:
                self.wfile.write(b"event: end\ndata: {}\n\n")
        except OSError:
            pass  # disconnected or too slow
        finally:
            server.readers.release()

    def _reply(self, status: int, body: bytes, headers: dict[str, str]) -> None:
        try:
            self._send_headers(status, {**headers, "Content-Length": str(len(body))})
            if self.command != "HEAD":
                self.wfile.write(body)
        except OSError:
            pass  # disconnected

    def _send_headers(self, status: int, headers: dict[str, str]) -> None:
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

    def version_string(self) -> str:
        """Return a name without a version."""
        return "rambler"

    def log_message(self, *_words: object) -> None:
        """Do not log requests, because they could fill the disk."""
