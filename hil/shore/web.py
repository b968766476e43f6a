"""Messages over HTTP in the RockBLOCK format, as POST requests from and to the provider."""

from __future__ import annotations

import json
import threading
import urllib.error
import urllib.parse
import urllib.request
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from hil.devices.message_post import IMEI_DIGITS, MessagePost
from hil.errors import UsageError

_MAX_BYTES = 16_384  # of a request
_MAX_MESSAGE_BYTES = 1960
_TIMEOUT_S = 10.0


def read_request(content_type: str, body: bytes) -> tuple[str, int, bytes]:
    """Return IMEI, number and message of a request with a form or JSON; raise ValueError for an invalid one."""
    if content_type.partition(";")[0].strip() == "application/json":
        values = json.loads(body)
        if not isinstance(values, dict):
            raise ValueError("not a JSON object")
        fields = {str(name): str(value) for name, value in values.items()}
    else:
        fields = dict(urllib.parse.parse_qsl(body.decode("ascii"), max_num_fields=32))
    imei, number, data = fields.get("imei", ""), fields.get("momsn", ""), fields.get("data", "")
    if not (len(imei) == IMEI_DIGITS and imei.isascii() and imei.isdigit()):
        raise ValueError("imei is not 15 digits")
    if not (number.isascii() and number.isdigit() and int(number[:6]) <= 65535 and len(number) <= 5):
        raise ValueError("momsn is not a number up to 65535")
    message = bytes.fromhex(data)
    if len(message) > _MAX_MESSAGE_BYTES:
        raise ValueError("data is too long")
    return imei, int(number), message


class Inbox:
    """Server of POST requests in a thread; it replies 200 after the message is on disk."""

    def __init__(self, address: tuple[str, int], post: MessagePost) -> None:
        """Start to listen; raise UsageError if that fails."""

        class Handler(BaseHTTPRequestHandler):
            """One request."""

            timeout = _TIMEOUT_S

            def do_POST(self) -> None:
                size = self.headers.get("Content-Length", "")
                if not (size.isascii() and size.isdigit() and len(size) < 8 and int(size) <= _MAX_BYTES):
                    self._reply(413, "give Content-Length, up to 16384")
                    return
                try:
                    message = read_request(self.headers.get("Content-Type", ""), self.rfile.read(int(size)))
                except (ValueError, RecursionError) as error:
                    self._reply(400, str(error)[:200])
                    return
                try:
                    post.put(*message)
                except OSError as error:
                    self._reply(503, str(error.strerror))
                    return
                self._reply(200, "OK")

            def _reply(self, code: int, text: str) -> None:
                body = text.encode("ascii", "replace") + b"\n"
                self.send_response(code)
                self.send_header("Content-Type", "text/plain")
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - http.server's name
                """Log nothing; the gateway reports messages."""

        try:
            self._server = ThreadingHTTPServer(address, Handler)
        except OSError as error:
            raise UsageError(f"--http {address[0]}:{address[1]}: {error.strerror}; give another port") from None
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(target=self._server.serve_forever, name="inbox", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the server."""
        self._server.shutdown()
        self._server.server_close()


@dataclass(frozen=True, slots=True)
class Sender:
    """The provider's service for messages to the boat, and the account there."""

    url: str
    user: str
    password: str

    def send(self, imei: str, message: bytes) -> str:
        """Send a message; return the reason of a rejection, else an empty text. After an OSError try again."""
        fields = {"imei": imei, "username": self.user, "password": self.password, "data": message.hex()}
        request = urllib.request.Request(self.url, urllib.parse.urlencode(fields).encode(), method="POST")  # noqa: S310 - http only, checked
        with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as reply:  # noqa: S310
            text = reply.read(400).decode("ascii", "replace").strip()
        return "" if text.split(",")[0] == "OK" else text or "empty reply"
