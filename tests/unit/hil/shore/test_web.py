"""Messages over HTTP from and to the service of the provider."""

import contextlib
import json
import threading
import urllib.error
import urllib.parse
import urllib.request
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from hil.devices.message_post import FROM_BOAT, MessagePost
from hil.errors import UsageError
from hil.shore.web import Inbox, Sender

IMEI = "300234010753370"
FORM = {
    "imei": IMEI, "serial": "12345", "momsn": "17", "transmit_time": "26-11-22 10:41:50",
    "iridium_latitude": "52.3867", "iridium_longitude": "0.2938", "iridium_cep": "8", "data": b"hello".hex(),
}  # fmt: skip


@pytest.fixture
def post(tmp_path):
    return MessagePost(tmp_path, FROM_BOAT)


@pytest.fixture
def inbox(post):
    with contextlib.closing(Inbox(("127.0.0.1", 0), post)) as inbox:
        yield inbox


def post_request(inbox, body, kind="application/x-www-form-urlencoded"):
    request = urllib.request.Request(f"http://127.0.0.1:{inbox.port}/", body, {"Content-Type": kind}, method="POST")
    try:
        with urllib.request.urlopen(request, timeout=30) as reply:
            return reply.status
    except urllib.error.HTTPError as error:
        return error.code


def test_form_and_json_are_stored_and_repetitions_ignored(inbox, post):
    body = urllib.parse.urlencode(FORM).encode()
    assert [post_request(inbox, body), post_request(inbox, body)] == [200, 200]
    assert list(post.take()) == [(IMEI, 17, b"hello")]
    assert post_request(inbox, body) == 200
    assert list(post.take()) == []
    assert post_request(inbox, json.dumps(FORM | {"momsn": 18}).encode(), "application/json") == 200
    assert list(post.take()) == [(IMEI, 18, b"hello")]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("imei", "../../../etc/pas"),
        ("imei", "30023401075337\u0663"),
        ("momsn", "-1"),
        ("momsn", "70000"),
        ("data", "xyz"),
    ],
)
def test_invalid_message_is_rejected(inbox, post, field, value):
    assert post_request(inbox, urllib.parse.urlencode(FORM | {field: value}).encode()) == 400
    assert list(post.take()) == []


def test_invalid_and_too_large_bodies_are_rejected(inbox):
    assert post_request(inbox, b"[" * 5000, "application/json") == 400
    assert post_request(inbox, bytes(20_000)) == 413


def test_port_in_use_raises_an_error(inbox, post):
    with pytest.raises(UsageError, match="give another port"):
        Inbox(("127.0.0.1", inbox.port), post)


@pytest.mark.parametrize(
    ("output", "reason"), [("OK,4114651", ""), ("FAILED,10,Invalid login credentials", "FAILED,10")]
)
def test_message_is_sent_to_the_service(output, reason):
    calls = []

    class Service(BaseHTTPRequestHandler):
        def do_POST(self):
            calls.append(urllib.parse.parse_qs(self.rfile.read(int(self.headers["Content-Length"])).decode()))
            self.send_response(200)
            self.end_headers()
            self.wfile.write(output.encode())

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Service) as server:
        thread = threading.Thread(target=server.handle_request)
        thread.start()
        sender = Sender(f"http://127.0.0.1:{server.server_address[1]}/rockblock/MT", "me", "secret")
        assert sender.send(IMEI, b"\xb5x").startswith(reason)
        thread.join()
    assert calls == [{"imei": [IMEI], "username": ["me"], "password": ["secret"], "data": ["b578"]}]
