"""What `rambler view` prints and reads."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_py.cli.view import _find_directory, _format_url


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


def test_state_directory_of_the_command_line_is_used():
    assert _find_directory(Path("boat")) == Path("boat")
