"""Boats with the real autopilot, closed after each test."""

import contextlib

import pytest

from support.boat import Boat
from support.plans import mission_file
from support.processes import running_devices
from support.service_boat import ITEMS, SETTINGS, ServiceBoat


@pytest.fixture
def make_boat(tmp_path):
    """Return a function that makes a boat in its own directory without starting it."""
    with contextlib.ExitStack() as boats:

        def make(name="boat", **options):
            (tmp_path / name).mkdir()
            return boats.enter_context(Boat(tmp_path / name, **options))

        yield make


@pytest.fixture
def fault_bench(make_boat):
    """Return a function that makes a boat in lockstep and starts the autopilot."""
    return lambda name="boat", **options: make_boat(name, **options).start()


@pytest.fixture
def make_service(make_boat):
    """Return a context manager of a service; the devices of its boat run in a thread."""

    @contextlib.contextmanager
    def make(**options):
        boat = make_boat(speed=None, settings=SETTINGS, without=("link",), plans=[mission_file(*ITEMS)])
        service = ServiceBoat(boat, **options)
        with running_devices(boat), service.manager, service.station.socket:
            yield service

    return make
