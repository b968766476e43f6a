from concurrent.futures import Future

import pytest

from hil.errors import HilError, UsageError
from hil.lab.campaign import campaign, compiled_engine, crew
from hil.lab.campaign.campaign import Crew
from hil.lab.campaign.engines import versions
from hil.lab.campaign.row import rows
from hil.lab.twin import loop
from support.campaign import read

pytestmark = pytest.mark.timeout(600)  # the twin is compiled first


class Pool:
    """An executor that does at once what it is given."""

    def __init__(self):
        self.given = 0

    def submit(self, work, *words):
        self.given += 1
        future = Future()
        future.set_result(work(*words))
        return future


def batches(count):
    """Yield batches of ten runs."""
    return iter([(10 * number, 10 * number + 10) for number in range(count)])


def work(_spec, first, last):
    """Return what a worker of the same version returns."""
    return versions(), [first, last]


def test_every_batch_comes_back_once_and_few_are_given_out_before():
    pool, waiting = Pool(), {}
    sailing = crew._sailed(pool, work, read(), batches(20), lambda: 2, waiting)
    found = [next(sailing)]
    assert pool.given == 2 * crew.WAITING
    found += sailing
    assert sorted(batch for batch, _ in found) == list(batches(20))
    assert all(list(batch) == results for batch, results in found)
    assert not waiting


def test_a_worker_of_another_version_is_not_believed():
    def other(_spec, _first, _last):
        return {**versions(), "numpy": "0", "sources": "?"}, []

    waiting = {}
    with pytest.raises(HilError, match="other versions than this computer: numpy, sources; go on with --resume"):
        list(crew._sailed(Pool(), other, read(), batches(3), lambda: 1, waiting))
    assert list(waiting.values())  # what was in hand is still known


def test_a_worker_with_another_c_library_has_another_version(monkeypatch):
    monkeypatch.setattr("platform.libc_ver", lambda: ("glibc", "1.0"))
    assert {**versions(), "libc": "glibc 1.0"} == versions.__wrapped__() != versions()


def test_a_cluster_without_workers_waits_for_them_with_something_to_do():
    assert len(list(crew._sailed(Pool(), work, read(), batches(5), lambda: 0, {}))) == 5


def test_a_cluster_without_workers_is_told_once(monkeypatch, capsys):
    monkeypatch.setattr(crew, "PATIENCE_S", 0.0)
    found, asked = Future(), []

    class Slow(Pool):
        def submit(self, _work, *_words):
            return found

    def workers():
        asked.append(None)
        if len(asked) == 5:
            found.set_result((versions(), []))
        return 0

    assert list(crew._sailed(Slow(), work, read(), batches(1), workers, {})) == [((0, 10), [])]
    said = capsys.readouterr().err
    assert said == "rambler-hil: the scheduler has no workers; it goes on when there are some\n"


def test_what_sails_is_made_ready_once_before_there_are_workers(monkeypatch):
    done = []
    monkeypatch.setattr(compiled_engine, "make_ready", lambda row: done.append(row.index))
    monkeypatch.setattr(crew, "sail_here", lambda _spec, given, workers: done.append(workers) or given)
    assert list(campaign._sailed(read(), Crew(3), None, batches(2))) == list(batches(2))
    assert done == [0, 3]
    assert list(campaign._sailed(read(), Crew(3), None, batches(0))) == []
    assert done == [0, 3]  # nothing is left to be sailed, and nothing is compiled


@pytest.mark.proof
def test_a_short_run_makes_ready_what_sails_long_ones():
    row = next(rows(read(), 0, 1))
    before = len(loop.voyage.signatures)
    compiled_engine.make_ready(row)
    ready = len(loop.voyage.signatures)
    assert ready >= max(before, 1)
    compiled_engine.sailed(row)
    assert len(loop.voyage.signatures) == ready


def test_an_address_that_is_none_is_refused_before_it_is_tried():
    for address in ("fish", "tcp://", "tcp://host", "http://host:1/x"):
        with pytest.raises(UsageError, match="write tcp://HOST:PORT"):
            crew.check_address(address)
