"""Boats with the real autopilot aboard, closed whatever becomes of the test."""

import contextlib

import pytest

from support.boat import Boat


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
