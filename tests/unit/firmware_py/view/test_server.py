"""The server of the live page: replies, limits, slow readers."""

import http.client
import json
import select
import socket
import threading
from types import SimpleNamespace

import pytest

from firmware_py.view import server as server_module
from firmware_py.view.guard import Guard, ViewError
from firmware_py.view.history import COLUMNS, History
from firmware_py.view.server import Hub, ViewServer

TIMEOUT_S = 20.0
HEADING_INDEX = COLUMNS.index("heading_deg")


class Site:
    def __init__(self, guard=None):
        self.history = History()
        self.hub = Hub(self.history.all_data)
        self.server = ViewServer(("127.0.0.1", 0), guard or Guard("", is_loopback=True), self.hub)
        self.port = self.server.server_address[1]
        self._thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        self._thread.start()
        self.time_s = 0.0
        self._resources = []

    def request(self, method="GET", target="/", **headers):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=TIMEOUT_S)
        connection.request(method, target, headers={name.replace("_", "-"): value for name, value in headers.items()})
        self._resources += (response := connection.getresponse()), connection
        return response

    def connect(self, count=1):
        """Return connections with an incomplete request."""
        connections = []
        for _ in range(count):
            connections.append(socket.create_connection(("127.0.0.1", self.port), TIMEOUT_S))
            connections[-1].sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: ")
        self._resources += connections
        return connections

    def read(self):
        """Open a stream of updates."""
        return Reader(self.request(target="/events"))

    def publish(self, **row):
        self.time_s += 1.0
        self.hub.publish(lambda: (self.history.add({"time_s": self.time_s, **row}, [], {}), self.history.epoch))

    def close(self):
        self.hub.close(is_over=True)
        self.server.shutdown()
        self.server.server_close()
        self._thread.join(TIMEOUT_S)
        for resource in self._resources:
            resource.close()


class Reader:
    def __init__(self, response):
        self.response = response

    def next(self):
        kind = data = ""
        while line := self.response.readline().decode().strip():
            name, _, rest = line.partition(": ")
            kind = rest if name == "event" else kind
            data = json.loads(rest) if name == "data" else None
        return kind, data  # "" and None for a keep-alive comment


@pytest.fixture
def site(monkeypatch):
    monkeypatch.setattr(server_module, "KEEPALIVE_S", 60.0)  # so that an update that wakes no reader is an error
    site = Site()
    yield site
    site.close()


@pytest.mark.parametrize("write", [str, str.lower, str.upper])
def test_header_names_are_case_insensitive(site, write):
    def status(*headers):
        with socket.create_connection(("127.0.0.1", site.port), TIMEOUT_S) as client:
            lines = [f"{write(name)}: {value}" for name, value in headers]
            client.sendall("\r\n".join(["GET / HTTP/1.1", *lines, "", ""]).encode())
            return int(client.makefile("rb").readline().split()[1])

    host = ("Host", f"127.0.0.1:{site.port}")
    assert status(host) == 200
    assert status(host, ("Origin", "http://evil.example")) == 403
    assert status(host, ("Sec-Fetch-Site", "cross-site")) == 403
    assert status(host, ("Host", "evil.example")) == 421


def test_page_has_security_headers(site):
    response = site.request()
    assert response.status == 200
    assert response.headers["Content-Security-Policy"].startswith("default-src 'none'")
    assert "frame-ancestors 'none'" in response.headers["Content-Security-Policy"]
    assert response.headers["X-Content-Type-Options"] == "nosniff"
    assert response.headers["Cache-Control"] == "no-store"
    assert response.headers["Server"] == "rambler"
    assert b'id="live"' in response.read()


def test_other_paths_are_not_found(site):
    assert [site.request(target=target).status for target in ("/etc/passwd", "/../", "/events/", "/status")] == [
        404
    ] * 4
    assert site.request("POST").status == 405
    assert site.request(Host="evil.example").status == 421
    assert site.request("HEAD").read() == b""


def test_token_becomes_an_http_only_cookie():
    site = Site(Guard("0123456789abcdef", is_loopback=False))
    try:
        assert site.request().status == 403
        response = site.request(target="/?token=0123456789abcdef")
        assert (response.status, response.headers["Location"]) == (303, "/")
        assert "HttpOnly" in response.headers["Set-Cookie"]
        cookie = response.headers["Set-Cookie"].partition(";")[0]
        assert site.request(Cookie=cookie).status == 200
    finally:
        site.close()


def test_reader_receives_all_data_then_updates(site):
    site.publish(heading_deg=10.0)
    reader = site.read()
    kind, data = reader.next()
    assert (kind, len(data["rows"])) == ("whole", 1)
    site.publish(heading_deg=11.0)
    kind, new = reader.next()
    assert kind == "new"
    assert new["rows"][0][data["names"].index("heading_deg")] == 11.0
    site.hub.close(is_over=True)
    assert "end" in (reader.next()[0], reader.next()[0])  # perhaps after a comment


def test_stopped_server_sends_no_end_event(site):
    site.publish(heading_deg=10.0)
    reader = site.read()
    assert reader.next()[0] == "whole"
    site.hub.close(is_over=False)
    assert b"event:" not in reader.response.read()


def test_reader_without_updates_receives_keep_alive_comments(site, monkeypatch):
    monkeypatch.setattr(server_module, "KEEPALIVE_S", 0.01)
    reader = site.read()
    assert [reader.next()[0] for _ in range(3)] == ["whole", "", ""]


def test_a_reader_waits_15_s_for_updates():
    hub, waits_s = Hub(bytes), []

    class Condition:
        def __enter__(self):
            pass

        def __exit__(self, *_error):
            pass

        def wait_for(self, is_new, timeout_s):
            waits_s.append((is_new(), timeout_s))

    hub._condition = Condition()
    assert hub.next((0, 0)) == ((0, 0), [])
    assert hub.next(None)[1] == [("whole", b"")]
    assert waits_s == [(False, 15.0)]


def test_readers_up_to_24_receive_updates(site):
    readers = [site.read() for _ in range(24)]
    refused = site.request(target="/events")
    assert (refused.status, refused.headers["Retry-After"]) == (503, "30")
    assert {reader.response.status for reader in readers} == {200}
    assert site.request().status == 200


def test_reader_far_behind_receives_all_data_again():
    history = History()
    hub = Hub(history.all_data)
    position, _ = hub.next(None)
    for number in range(64):
        hub.publish(lambda number=number: (history.add({"time_s": float(number)}, [], {}), 0))
    assert [kind for kind, _ in hub.next(position)[1]] == ["new"] * 64
    hub.publish(lambda: (None, 0))
    assert [kind for kind, _ in hub.next(position)[1]] == ["new"] * 64
    hub.publish(lambda: (history.add({"time_s": 64.0}, [], {}), 0))
    position, updates = hub.next(position)
    assert [kind for kind, _ in updates] == ["whole"]
    hub.publish(lambda: (history.add({"time_s": 1e3}, [], {}), 0))
    assert [kind for kind, _ in hub.next(position)[1]] == ["new"]
    hub.publish(lambda: (history.add({"time_s": 2e3}, [], {}), 1))
    assert [kind for kind, _ in hub.next(position)[1]] == ["whole"]  # of another epoch


def test_stuck_readers_delay_no_other_reader(site):
    site.publish()
    slow_readers = [socket.create_connection(("127.0.0.1", site.port)) for _ in range(9)]
    for connection in slow_readers:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    reader = site.read()
    assert reader.next()[0] == "whole"
    for number in range(300):  # more than the buffers of a socket
        site.publish(heading_deg=float(number))
    newest = 0
    while newest < 299.0:
        kind, content = reader.next()
        rows = content["rows"]
        newest = (
            rows[-1][content["names"].index("heading_deg")] if kind == "whole" else content["values"][HEADING_INDEX]
        )
    for connection in slow_readers:
        connection.close()


def received(connection):
    try:
        return connection.recv(12)
    except ConnectionResetError:
        return b""


def test_33rd_connection_is_closed_until_another_one_is_released(site):
    connections = site.connect(33)  # the kernel may pass them on in another order
    (refused,) = select.select(connections, [], [], TIMEOUT_S)[0]
    assert received(refused) == b""
    connections.remove(refused)
    for connection in connections:
        connection.sendall(b"\r\n\r\n")
        assert received(connection) == b"HTTP/1.0 200"
        connection.close()
    assert site.request().status == 200


def test_incomplete_request_is_closed_after_ten_seconds(site, monkeypatch):
    now_s = [1000.0]
    monkeypatch.setattr(server_module, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    reader = site.read()
    assert reader.next()[0] == "whole"
    slow, slower = site.connect(2)
    while len(site.server._pending) < 2:
        threading.Event().wait(0.001)
    now_s[0] += 9.9
    site.server.service_actions()
    slow.sendall(b"\r\n\r\n")
    assert received(slow) == b"HTTP/1.0 200"
    now_s[0] += 0.2
    site.server.service_actions()
    assert received(slower) == b""
    site.publish()
    assert reader.next()[0] == "new"  # its request was complete


INVALID_REQUESTS = (
    b"\0" * 100,
    b"GET\r\n\r\n",
    b"GET / HTTP/9.9\r\n\r\n",
    b"A" * 70_000,
    b"GET / HTTP/1.1\r\n" + b"x: y\r\n" * 200,
)


@pytest.mark.parametrize("data", INVALID_REQUESTS)
def test_invalid_request_is_refused(site, data):
    with socket.create_connection(("127.0.0.1", site.port)) as connection:
        connection.settimeout(TIMEOUT_S)
        try:
            connection.sendall(data + b"\r\n\r\n")
            response = connection.recv(1 << 16)
        except (ConnectionResetError, BrokenPipeError):
            response = b""
    assert b"200" not in response.partition(b"\r\n")[0]
    assert site.request().status == 200


def test_address_in_use_is_an_error_with_remedy(site):
    with pytest.raises(ViewError) as error_info:
        ViewServer(("127.0.0.1", site.port), Guard("", is_loopback=True), site.hub)
    assert str(error_info.value) == f"127.0.0.1:{site.port}: Address already in use; use another --listen HOST:PORT"
