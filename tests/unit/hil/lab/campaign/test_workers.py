"""Distribution of batches to worker processes and to a cluster."""

from concurrent.futures import Future

import pytest

from hil.errors import HilError, UsageError
from hil.lab.campaign import campaign, compiled_engine, workers
from hil.lab.campaign.campaign import Workers
from hil.lab.campaign.engines import versions
from hil.lab.campaign.row import rows
from hil.lab.twin import loop
from support.campaign import read

pytestmark = pytest.mark.timeout(600)  # compiles the loop


class Pool:
    """An executor that runs each task when it is submitted."""

    def __init__(self):
        self.submitted = 0

    def submit(self, work, *arguments):
        self.submitted += 1
        future = Future()
        future.set_result(work(*arguments))
        return future


def batches(count):
    """Yield batches of ten runs."""
    return iter([(10 * number, 10 * number + 10) for number in range(count)])


def work(_spec, first, last):
    """Return the result of a worker of the same version."""
    return versions(), [first, last]


def test_each_batch_is_returned_once_and_few_are_submitted_in_advance():
    pool, pending = Pool(), {}
    batches_run = workers._run_batches(pool, work, read(), batches(20), lambda: 2, pending)
    finished = [next(batches_run)]
    assert pool.submitted == 2 * workers.QUEUED_BATCHES
    finished += batches_run
    assert sorted(batch for batch, _ in finished) == list(batches(20))
    assert all(list(batch) == results for batch, results in finished)
    assert not pending


def test_worker_of_another_version_is_rejected():
    def other(_spec, _first, _last):
        return {**versions(), "numpy": "0", "sources": "?"}, []

    pending = {}
    with pytest.raises(HilError, match="other versions than this computer: numpy, sources; continue with --resume"):
        list(workers._run_batches(Pool(), other, read(), batches(3), lambda: 1, pending))
    assert list(pending.values())  # submitted batches remain pending


def test_other_c_library_is_another_version(monkeypatch):
    monkeypatch.setattr("platform.libc_ver", lambda: ("glibc", "1.0"))
    assert {**versions(), "libc": "glibc 1.0"} == versions.__wrapped__() != versions()


def test_batches_are_submitted_to_a_cluster_without_workers():
    assert len(list(workers._run_batches(Pool(), work, read(), batches(5), lambda: 0, {}))) == 5


def test_cluster_without_workers_is_reported_once(monkeypatch, capsys):
    monkeypatch.setattr(workers, "TIMEOUT_S", 0.0)
    finished, calls = Future(), []

    class Slow(Pool):
        def submit(self, _work, *_words):
            return finished

    def worker_count():
        calls.append(None)
        if len(calls) == 5:
            finished.set_result((versions(), []))
        return 0

    assert list(workers._run_batches(Slow(), work, read(), batches(1), worker_count, {})) == [((0, 10), [])]
    assert capsys.readouterr().err == "rambler-hil: the scheduler has no workers; waiting for workers\n"


def test_loop_is_compiled_once_before_workers_start(monkeypatch):
    calls_made = []
    monkeypatch.setattr(compiled_engine, "make_ready", lambda row: calls_made.append(row.index))
    monkeypatch.setattr(workers, "run_locally", lambda _spec, batches, count: calls_made.append(count) or batches)
    assert list(campaign._run_batches(read(), Workers(3), None, batches(2))) == list(batches(2))
    assert calls_made == [0, 3]
    assert list(campaign._run_batches(read(), Workers(3), None, batches(0))) == []
    assert calls_made == [0, 3]  # without runs nothing is compiled


@pytest.mark.proof
def test_short_run_compiles_all_functions_of_a_long_run():
    row = next(rows(read(), 0, 1))
    count_before = len(loop.voyage.signatures)
    compiled_engine.make_ready(row)
    compiled_count = len(loop.voyage.signatures)
    assert compiled_count >= max(count_before, 1)
    compiled_engine.simulate_truth(row)
    assert len(loop.voyage.signatures) == compiled_count


def test_invalid_address_is_refused():
    for address in ("fish", "tcp://", "tcp://host", "http://host:1/x"):
        with pytest.raises(UsageError, match="write tcp://HOST:PORT"):
            workers.check_address(address)
