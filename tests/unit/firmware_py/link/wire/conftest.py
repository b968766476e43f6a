"""Local sockets."""

import socket

import pytest


@pytest.fixture
def closing_later():
    """Register sockets or transports that are closed at the end of the test."""
    resources = []

    def register(resource):
        resources.append(resource)
        return resource

    yield register
    for resource in resources:
        resource.close()


@pytest.fixture
def free_port():
    def find(kind=socket.SOCK_STREAM):
        with socket.socket(socket.AF_INET, kind) as probe:
            probe.bind(("127.0.0.1", 0))
            return probe.getsockname()[1]

    return find
