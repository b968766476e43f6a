"""File transfer while its thread waits for the disk."""

import select
import threading
from pathlib import Path

import pytest

NO_SESSIONS, FAIL = 5, 1  # errors; the numbers below are opcodes
TERMINATE, OPEN, CREATE, WRITE, OPEN_WRITE, MKDIR = 1, 4, 6, 7, 11, 9
LOG = "logs/00000001.BIN"


class BusyDisk:
    """A client of a rig whose disk is busy until `finish`."""

    def __init__(self, rig, client):
        self.rig, self.client, self.gate = rig, client, threading.Event()
        self.submit()

    def submit(self, count=1):
        return [self.rig.endpoint._worker.submit(self.gate.wait, lambda _result: None) for _ in range(count)]

    def finish(self):
        """Let the disk work until all jobs are done; return the replies."""
        self.gate.set()
        replies = []
        while self.rig.endpoint._worker.has_pending_jobs:
            descriptors = self.rig.endpoint.descriptors()[-1:]
            assert select.select(descriptors, [], [], 20.0)[0]
            self.rig.endpoint.service(self.rig.now_s, descriptors)
            replies += self.rig.replies()
        return replies


@pytest.fixture
def busy(stored, tmp_path):
    rig, client = stored(background=True)
    (tmp_path / LOG).write_bytes(b"content")
    disk = BusyDisk(rig, client)
    yield disk
    disk.gate.set()
    rig.endpoint.close()


def count_descriptors():
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.parametrize("opcode", [OPEN, OPEN_WRITE])
def test_limit_of_sessions_applies_when_the_files_are_open(busy, opcode):
    before, limit = count_descriptors(), {OPEN: 6, OPEN_WRITE: 4}[opcode]
    path = LOG if opcode == OPEN else "uploads/a"
    for number in range(limit + 1):
        assert busy.client.all(opcode, path, session=number) == []
    replies = busy.client.replies(busy.finish())
    assert [reply.ok for reply in replies] == [True] * limit + [False]
    assert replies[-1].error == (NO_SESSIONS,)
    assert count_descriptors() == before + (limit if opcode == OPEN else 0)


def test_duplicate_of_a_request_that_is_being_executed_is_ignored(busy):
    for _ in range(3):
        assert busy.client.all(MKDIR, "uploads/a", sequence=7) == []
    (reply,) = busy.client.replies(busy.finish())
    assert (reply.ok, reply.sequence) == (True, 8)


def test_uploads_that_are_being_stored_count_as_open(busy):
    client = busy.client
    for number in range(4):
        assert client.ask(CREATE, f"uploads/{number}", session=number).ok
        assert client.all(TERMINATE, session=number) == []
    assert client.ask(CREATE, "uploads/a", session=9).error == (NO_SESSIONS,)
    busy.rig.now_s += 60.0
    assert client.ask(CREATE, "uploads/b", session=9).error == (NO_SESSIONS,)
    assert [reply.ok for reply in client.replies(busy.finish())] == [True] * 4
    assert all(client.ask(CREATE, f"uploads/{number}", session=number).ok for number in range(4))
    assert client.ask(CREATE, "uploads/c", session=9).error == (NO_SESSIONS,)


def test_request_dropped_by_a_full_queue_is_executed_when_it_is_repeated(busy, texts, tmp_path):
    client = busy.client
    assert client.ask(CREATE, "uploads/a", session=1).ok
    assert client.ask(WRITE, b"content", session=1).ok
    assert busy.submit(31) == [True] * 31  # with the first job, the queue is full
    assert client.all(MKDIR, "uploads/d", sequence=70) == []
    replies = busy.rig.send(client.request(TERMINATE, session=1))
    assert [reply.error for reply in client.replies(replies)] == [(FAIL,)]
    assert texts(replies) == ["Disk busy: send the file again"]
    assert client.replies(busy.finish()) == []
    assert client.all(MKDIR, "uploads/d", sequence=70) == []
    assert [reply.ok for reply in client.replies(busy.finish())] == [True]
    assert [path.name for path in (tmp_path / "uploads").iterdir()] == ["d"]
