"""Access control of the live page."""

import pytest

from firmware_py.view.guard import Guard, ViewError, parse_listen_address, read_token

TOKEN = "0123456789abcdef"
LOCAL = Guard("", is_loopback=True)
REMOTE = Guard(TOKEN, is_loopback=False, names=frozenset(("boat", "boat.local")))
COOKIE = {"Host": "10.0.0.7:8046", "Cookie": f"rambler_view={TOKEN}"}


@pytest.mark.parametrize(
    "host", ["localhost", "localhost:8046", "127.0.0.1:8046", "127.9.9.9", "[::1]:8046", "LOCALHOST:1"]
)
def test_loopback_names_are_accepted(host):
    assert LOCAL.check("GET", "/", {"Host": host}).status == 200
    same_origin = {"Host": host, "Origin": f"http://{host}", "Sec-Fetch-Site": "same-origin"}
    assert LOCAL.check("HEAD", "/events", same_origin).path == "/events"


@pytest.mark.parametrize(
    "host",
    ["", "evil.example", "evil.example:8046", "127.0.0.1.evil.example", "localhost.evil.example:80", "10.0.0.7",
     "boat:8046", "0x7f000001", "2130706433", "127.1", "[::1", "::ffff:10.0.0.7",
     "localhost:80:80", "127.0.0.1:8046\r\nx", "\0"],
)  # fmt: skip
def test_other_host_names_are_refused(host):
    assert LOCAL.check("GET", "/", {"Host": host}).status == 421


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://localhost:8046"},
        {"Origin": "http://localhost:8047"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site", "Sec-Fetch-Mode": "no-cors"},
    ],
)
def test_cross_site_requests_are_refused(headers):
    assert LOCAL.check("GET", "/events", {"Host": "localhost:8046", **headers}).status == 403


def test_navigation_from_another_site_is_allowed():
    headers = {"Host": "localhost:8046", "Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}
    assert LOCAL.check("GET", "/", headers).status == 200


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH", "TRACE", "CONNECT", "get"])
def test_write_methods_are_refused(method):
    assert LOCAL.check(method, "/", {"Host": "localhost"}).status == 405


def test_remote_access_needs_the_token():
    assert REMOTE.check("GET", "/", {"Host": "10.0.0.7:8046"}).status == 403
    assert REMOTE.check("GET", "/events", COOKIE).status == 200
    verdict = REMOTE.check("GET", f"/?token={TOKEN}", {"Host": "boat.local:8046"})
    assert (verdict.status, verdict.path, verdict.sets_cookie) == (303, "/", True)
    assert REMOTE.check("GET", f"/events?token={TOKEN}", {"Host": "boat:8046"}).status == 403  # only for the page


@pytest.mark.parametrize(
    "token", ["", "0123456789abcde", "0123456789abcdef0", "é" * 16, "%00", TOKEN.upper(), f"{TOKEN}&token={TOKEN}"]
)
def test_wrong_token_is_refused(token):
    assert REMOTE.check("GET", f"/?token={token}", {"Host": "10.0.0.7"}).status == 403
    assert REMOTE.check("GET", "/", {"Host": "10.0.0.7", "Cookie": "rambler_view=x; rambler_view"}).status == 403


def test_request_target_of_more_than_1024_characters_is_refused():
    lengths = (1024, 1025)
    assert [LOCAL.check("GET", "x" * length, {"Host": "localhost"}).status for length in lengths] == [200, 414]


@pytest.mark.parametrize(
    ("listen", "host", "port", "is_loopback"),
    [("127.0.0.1:8046", "127.0.0.1", 8046, True), ("localhost:0", "127.0.0.1", 0, True),
     ("[::1]:65535", "::1", 65535, True), ("0.0.0.0:1", "0.0.0.0", 1, False), ("10.0.0.7:80", "10.0.0.7", 80, False)],
)  # fmt: skip
def test_listen_address_needs_a_token_unless_it_is_a_loopback_address(listen, host, port, is_loopback):
    assert parse_listen_address(listen, with_token=True) == (host, port, is_loopback)
    if is_loopback:
        assert parse_listen_address(listen, with_token=False) == (host, port, is_loopback)
    else:
        with pytest.raises(ViewError, match="needs a token"):
            parse_listen_address(listen, with_token=False)


@pytest.mark.parametrize("listen", ["", "8046", "127.0.0.1", "127.0.0.1:", "127.0.0.1:x", "127.0.0.1:65536",
                                    "127.0.0.1:-1", "boat:8046", ":8046"])  # fmt: skip
def test_invalid_listen_address_is_refused(listen):
    with pytest.raises(ViewError, match="not an address"):
        parse_listen_address(listen, with_token=True)


@pytest.mark.parametrize("target", ["//evil.example/", "http://[", "/?token=%ff%fe", "*", "\0"])
def test_invalid_request_target_is_refused(target):
    assert REMOTE.check("GET", target, {"Host": "10.0.0.7"}).status == 403


def test_token_file_must_be_private_and_valid(tmp_path):
    path = tmp_path / "token"
    path.touch(mode=0o600)
    for token in (TOKEN, "x" * 256):
        path.write_text(token + "\n")
        assert read_token(path) == token
    path.write_text(token + " " * (4096 - 256))
    assert read_token(path) == token
    path.write_text(token + " " * (4097 - 256))
    with pytest.raises(ViewError, match="large"):
        read_token(path)
    path.write_text(token)
    for mode in (0o601, 0o602, 0o604):
        path.chmod(mode)
        with pytest.raises(ViewError, match="chmod 600"):
            read_token(path)
    path.chmod(0o640)
    assert read_token(path) == token
    for text in ("", "x" * 15, "x" * 257, "with spaces in it here", "\xff" * 20):
        path.write_text(text, encoding="latin-1")
        with pytest.raises(ViewError, match="openssl rand"):
            read_token(path)
    with pytest.raises(ViewError, match="openssl rand"):
        read_token(tmp_path / "nothing")
