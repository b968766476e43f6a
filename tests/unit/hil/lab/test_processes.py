"""Worker processes: an aborted pool leaves no thread."""

import threading
import time

import pytest

from hil.lab.processes import processes


def test_aborted_pool_leaves_no_thread():
    """A remaining thread could print "Bad file descriptor" at the exit of the interpreter."""
    threads_before = set(threading.enumerate())

    def abort():
        with processes(1) as pool:
            pool.submit(time.sleep, 60.0)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        abort()
    assert set(threading.enumerate()) == threads_before
