"""Boats with the real autopilot, closed after each test."""

import contextlib
import threading

import pytest

from support.boat import Boat
from support.plans import mission_file
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
    """Return a context manager of a service; its boat runs in a thread."""
    is_over, threads = threading.Event(), []

    @contextlib.contextmanager
    def make(**options):
        boat = make_boat(speed=None, settings=SETTINGS, without=("link",), plans=[mission_file(*ITEMS)])
        boat.time.begin(boat.board, None)

        def run_boat():
            while not is_over.is_set():
                boat.time.step(boat.board, boat.now_s + 0.05)

        service = ServiceBoat(boat, **options)
        threads.append(threading.Thread(target=run_boat))
        threads[-1].start()
        with service.manager, service.station.socket:
            yield service

    yield make
    is_over.set()
    for thread in threads:
        thread.join()
