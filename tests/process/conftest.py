"""Boats with the real autopilot aboard, closed whatever becomes of the test."""

import contextlib
import threading

import pytest

from support.boat import Boat
from support.plans import mission_file
from support.service_boat import ITEMS, SETTINGS, ServiceBoat


@pytest.fixture
def make_boat(tmp_path):
    """Make boats, each in a directory of its own; they are not started yet."""
    with contextlib.ExitStack() as open_boats:

        def make(name="boat", **options):
            (tmp_path / name).mkdir()
            return open_boats.enter_context(Boat(tmp_path / name, **options))

        yield make


@pytest.fixture
def fault_bench(make_boat):
    """Make boats in lockstep and start the autopilot."""
    return lambda name="boat", **options: make_boat(name, **options).start()


@pytest.fixture
def make_service(make_boat):
    """Make a boat that lives in a thread of its own, and its service."""
    ended, threads = threading.Event(), []

    @contextlib.contextmanager
    def make(**more):
        boat = make_boat(speed=None, settings=SETTINGS, without=("link",), plans=[mission_file(*ITEMS)])
        boat.time.begin(boat.board, None)

        def live():
            while not ended.is_set():
                boat.time.step(boat.board, boat.now_s + 0.05)

        service = ServiceBoat(boat, **more)
        threads.append(threading.Thread(target=live))
        threads[-1].start()
        with service.manager, service.station.socket:
            yield service

    yield make
    ended.set()
    for thread in threads:
        thread.join()
