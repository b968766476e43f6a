"""Background thread for disk work."""

import os
import select
import threading

import pytest

from firmware_py.common.records import Progress
from firmware_py.link.wire.worker import Worker


@pytest.fixture
def worker(closing_later):
    return closing_later(Worker(background=True))


def is_ready(worker, timeout_s):
    return bool(select.select([worker.fileno()], [], [], timeout_s)[0])


def poll(worker):
    assert is_ready(worker, 10.0)
    worker.poll()


def test_job_runs_on_its_thread_and_the_callback_on_the_callers(worker):
    calls, may_end = [], threading.Event()

    def job():
        assert may_end.wait(10.0)
        return threading.get_native_id()

    assert not worker.has_pending_jobs
    assert not is_ready(worker, 0.0)
    worker.submit(job, lambda result: calls.append((result, threading.get_native_id())))
    assert worker.has_pending_jobs
    (before,) = worker.progress()
    may_end.set()
    poll(worker)
    assert not worker.has_pending_jobs
    ((job_thread, callback_thread),) = calls
    assert callback_thread == threading.get_native_id() != job_thread
    # A job may read a large log for five minutes.
    assert before == Progress("link files", True, 0, 300.0, True, job_thread)
    assert worker.progress() == (Progress("link files", False, 1, 300.0, True, job_thread),)


def test_exception_of_a_job_is_its_result(worker):
    results = []
    worker.submit(lambda: 1 // 0, results.append)
    poll(worker)
    assert isinstance(results[0], ZeroDivisionError)
    worker.poll()
    assert len(results) == 1


def test_number_of_jobs_is_limited(worker):
    gate, results = threading.Event(), []
    assert all(worker.submit(gate.wait, results.append) for _ in range(32))
    assert not worker.submit(gate.wait, results.append)
    gate.set()
    while len(results) < 32:
        poll(worker)
    assert worker.submit(gate.wait, results.append)


def test_queued_jobs_are_finished_at_the_end(worker):
    done = []
    for number in range(32):
        worker.submit(lambda number=number: done.append((number, sum(range(50_000)))), print)
    thread = worker._thread
    assert thread.daemon  # a disk that does not respond must not delay the end of the program
    worker.close()
    assert not thread.is_alive()
    assert [number for number, _ in done] == list(range(32))
    assert (worker.fileno(), worker.progress()) == (-1, ())
    worker.close()


def test_without_thread_a_job_is_executed_at_once():
    results = []
    worker = Worker(background=False)
    assert worker.submit(lambda: 5, results.append)
    assert results == [5]
    assert worker.fileno() == -1
    worker.poll()
    assert (worker.has_pending_jobs, worker.progress()) == (False, ())
    worker.close()


def test_result_may_be_polled_before_its_event_is_written(worker, monkeypatch):
    """The loop may poll between the two; that once ended the autopilot under a flood."""
    results, job_done, may_write, is_written = [], threading.Event(), threading.Event(), threading.Event()
    write = os.eventfd_write

    def write_late(descriptor, value):
        may_write.wait(10.0)
        write(descriptor, value)
        is_written.set()

    monkeypatch.setattr(os, "eventfd_write", write_late)
    worker.submit(job_done.set, results.append)
    assert job_done.wait(10.0)
    while not results:
        worker.poll()
    assert not is_ready(worker, 0.0)
    may_write.set()
    assert is_written.wait(10.0)
    worker.poll()
    assert not is_ready(worker, 0.0)  # otherwise the loop would never sleep
    assert results == [None]
