"""Messages over HTTP, from a client as the provider's service is one, and to a service as the provider's is one."""

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
    with contextlib.closing(Inbox(("127.0.0.1", 0), post)) as made:
        yield made


def posted(inbox, body, kind="application/x-www-form-urlencoded"):
    request = urllib.request.Request(f"http://127.0.0.1:{inbox.port}/", body, {"Content-Type": kind}, method="POST")
    try:
        with urllib.request.urlopen(request, timeout=30) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


def test_a_form_and_json_are_taken_and_a_repetition_counts_once(inbox, post):
    body = urllib.parse.urlencode(FORM).encode()
    assert [posted(inbox, body), posted(inbox, body)] == [200, 200]
    assert list(post.take()) == [(IMEI, 17, b"hello")]
    assert posted(inbox, body) == 200
    assert list(post.take()) == []
    assert posted(inbox, json.dumps(FORM | {"momsn": 18}).encode(), "application/json") == 200
    assert list(post.take()) == [(IMEI, 18, b"hello")]


@pytest.mark.parametrize(
    "change",
    [
        {"imei": "../../../etc/pas"},
        {"imei": "30023401075337\u0663"},
        {"momsn": "-1"},
        {"momsn": "70000"},
        {"data": "xyz"},
    ],
)
def test_what_is_no_message_is_refused_and_leaves_nothing(inbox, post, change):
    assert posted(inbox, urllib.parse.urlencode(FORM | change).encode()) == 400
    assert list(post.take()) == []


def test_noise_and_too_much_are_refused(inbox):
    assert posted(inbox, b"[" * 5000, "application/json") == 400
    assert posted(inbox, bytes(20_000)) == 413


def test_a_port_that_is_taken_is_an_error_with_a_remedy(inbox, post):
    with pytest.raises(UsageError, match="give another port"):
        Inbox(("127.0.0.1", inbox.port), post)


@pytest.mark.parametrize(
    ("output", "refusal"), [("OK,4114651", ""), ("FAILED,10,Invalid login credentials", "FAILED,10")]
)
def test_a_message_is_handed_to_the_service(output, refusal):
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
        assert sender.send(IMEI, b"\xb5x").startswith(refusal)
        thread.join()
    assert calls == [{"imei": [IMEI], "username": ["me"], "password": ["secret"], "data": ["b578"]}]
