"""Processes that sail runs: what is left of them when they are given up."""

import threading
import time

import pytest

from hil.lab.processes import processes


def test_nothing_of_a_pool_that_is_given_up_is_left():
    """Its thread was, and an interpreter that ended meanwhile might say "Bad file descriptor" behind the last word."""
    before = set(threading.enumerate())

    def given_up():
        with processes(1) as pool:
            pool.submit(time.sleep, 60.0)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        given_up()
    assert set(threading.enumerate()) == before
