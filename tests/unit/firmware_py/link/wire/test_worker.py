"""Disk work in the background: results come on the caller's thread, and there is never too much of it."""

import os
import select
import threading

import pytest

from firmware_py.link.wire.worker import Worker


@pytest.fixture
def worker():
    made = Worker(background=True)
    yield made
    made.close()


def wait(worker):
    assert select.select([worker.fileno()], [], [], 10.0)[0]
    worker.poll()


def test_results_come_by_poll_on_this_thread(worker):
    seen = []
    worker.submit(threading.get_ident, lambda result: seen.append((result, threading.get_ident())))
    wait(worker)
    ((worked, reports),) = seen
    assert reports == threading.get_ident() != worked


def test_what_goes_wrong_is_a_result(worker):
    seen = []
    worker.submit(lambda: 1 // 0, seen.append)
    wait(worker)
    assert isinstance(seen[0], ZeroDivisionError)
    worker.poll()
    assert len(seen) == 1


def test_jobs_are_bounded(worker):
    gate, seen = threading.Event(), []
    assert all(worker.submit(gate.wait, seen.append) for _ in range(32))
    assert not worker.submit(gate.wait, seen.append)
    gate.set()
    while len(seen) < 32:
        wait(worker)
    assert worker.submit(gate.wait, seen.append)


def test_without_a_thread_a_job_is_done_at_once():
    seen = []
    worker = Worker(background=False)
    assert worker.submit(lambda: 5, seen.append)
    assert seen == [5]
    assert worker.fileno() == -1
    worker.poll()
    worker.close()


def test_a_result_may_be_there_before_its_sign(worker, monkeypatch):
    """The loop looks between the two; that ended the autopilot under a flood."""
    seen, going_on = [], threading.Event()
    write = os.eventfd_write
    signed = threading.Event()

    def late(descriptor, value):
        going_on.wait(10.0)
        write(descriptor, value)
        signed.set()

    monkeypatch.setattr(os, "eventfd_write", late)
    done = threading.Event()
    worker.submit(done.set, seen.append)
    assert done.wait(10.0)
    while not seen:
        worker.poll()
    assert not select.select([worker.fileno()], [], [], 0.0)[0]
    going_on.set()
    assert signed.wait(10.0)
    worker.poll()
    assert not select.select([worker.fileno()], [], [], 0.0)[0]  # or the loop would turn without a rest
    assert seen == [None]
