"""URL of the page that `rambler view` prints."""

from types import SimpleNamespace

import pytest

from firmware_py.cli.view import _format_url


@pytest.mark.parametrize(
    ("host", "token", "url"),
    [
        ("127.0.0.1", "", "http://127.0.0.1:8080/"),
        ("::1", "", "http://[::1]:8080/"),
        ("0.0.0.0", "secret", "http://0.0.0.0:8080/?token=..."),
    ],
)
def test_url_has_brackets_around_an_address_of_ipv6_and_no_token(host, token, url):
    server = SimpleNamespace(server_address=(host, 8080), guard=SimpleNamespace(token=token))
    assert _format_url(server) == url
