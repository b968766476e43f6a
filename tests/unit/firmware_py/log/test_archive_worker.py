"""Compression of closed logs and black boxes of the minutes before restarts and severe faults."""

import itertools
import os

import msgspec
import pytest

from firmware_py.common.records import DeviceState
from firmware_py.log import archive_worker, schema
from firmware_py.log.archive_worker import ArchiveWorker
from firmware_py.log.black_box import find_next_tick
from firmware_py.log.disk import log_files
from firmware_py.log.reader import LogReader

IDLE_TURNS = 20
RETRY_TURNS = 60

START_S = 12.3


class Run:
    """A run of the program with one tick and one turn of the writer per second."""

    def __init__(self, fake, directory, **options):
        self.fake = fake
        self.recorder = fake.make_recorder(directory, clock_utc_s=lambda: 1.8e9, **options)
        self.state, self.index = fake.State(), 0

    def sail(self, seconds):
        for _ in range(seconds):
            inputs = self.fake.make_inputs(self.index)
            t_s = START_S + self.index
            inputs = msgspec.structs.replace(inputs, tick=msgspec.structs.replace(inputs.tick, t_s=t_s), requests=())
            previous, (self.state, output) = self.state, self.fake.step(self.state, inputs)
            snapshot = msgspec.structs.replace(output.snapshot, faults=0, t_s=t_s)
            output = msgspec.structs.replace(output, snapshot=snapshot)
            self.recorder.offer(inputs, output, lambda state=previous: self.fake.to_text(state))
            self.index += 1
            self.turn()
        return self

    def turn(self, count=1):
        for _ in range(count):
            writer = self.recorder.writer
            taken_bytes = writer._taken_total_bytes
            writer.drain()
            self.recorder._do_background_work(writer._taken_total_bytes - taken_bytes)
        return self

    def kill(self):
        """Close the files without closing the log, after the last second is on disk."""
        self.turn()
        if self.recorder.writer._file is not None:
            os.close(self.recorder.writer._file[0])
        self.recorder._thin_file.close()


def times_of(path):
    return [tick.inputs.tick.t_s for tick in LogReader(path)]


def boxes(directory):
    return sorted(path.name for path in (directory / "boxes").glob("*"))


def log_names(directory):
    return [path.name for path in log_files(directory).values()]


def fail(*_arguments):
    raise OSError(28, "No space left on device")


@pytest.fixture
def worker(tmp_path, monkeypatch):
    """An archive worker with two closed logs, whose jobs are recorded and have steps without end."""
    for number in (1, 2, 3):
        (tmp_path / f"{number:08d}.BIN").touch()
    worker = ArchiveWorker(tmp_path)
    worker.jobs, worker.steps, worker.errors = [], 0, []

    def job(*words):
        worker.jobs.append(words)
        if worker.errors:
            raise worker.errors.pop()
        while worker.steps >= 0:
            worker.steps += 1
            yield

    monkeypatch.setattr(archive_worker, "archive_log", lambda path: job(path.name))
    monkeypatch.setattr(archive_worker, "make_box", lambda log, *event: job(log.name, *event))
    monkeypatch.setattr(archive_worker, "is_first_of_run", lambda _log: False)
    return worker


def test_steps_are_in_proportion_to_the_bytes_written(worker):
    for written_bytes, steps in ((0, 1), (32_767, 1), (32_768, 2), (3 << 16, 7)):
        worker.steps = 0
        worker.work(written_bytes)
        assert worker.steps == steps
    assert worker.jobs == [("00000001.BIN",)]


def test_a_box_is_made_32_s_after_a_severe_fault_and_once_in_600_s(worker):
    counts = []
    for t_s in (0.0, 31.9, 32.0, 599.9, 600.0, 631.9, 632.0):
        worker.note_tick(t_s, is_severe=True)
        worker.work(0)
        worker._box_job = None
        boxes = [job for job in worker.jobs if len(job) == 3]
        counts.append(len(boxes))
    assert counts == [0, 0, 1, 1, 1, 1, 2]
    assert boxes == [("00000003.BIN", "0", 0.0), ("00000003.BIN", "600", 600.0)]


def test_the_last_four_severe_faults_have_boxes_if_the_disk_is_slow(worker):
    for number in range(6):
        worker.note_tick(600.0 * number, is_severe=True)
    worker.note_tick(9999.0, is_severe=False)
    for _ in range(5):
        worker.work(0)
        worker._box_job = None
    assert [job[2] for job in worker.jobs if len(job) == 3] == [1200.0, 1800.0, 2400.0, 3000.0]


def test_a_failed_log_is_tried_again_after_60_turns_and_the_others_first(worker):
    worker.errors = [ValueError(), OSError(28, "No space"), RuntimeError("broken")]
    failures = []
    for _ in range(4):
        worker.work(0)
        failures.append(worker.failure)
        for _ in range(60):
            worker.work(0)
            failures.append(worker.failure)
    texts = ["log: not compressed: broken", "log: not compressed: No space", "log: not compressed: ValueError"]
    assert [failures[61 * number] for number in range(3)] == texts
    assert worker.jobs == [("00000001.BIN",), ("00000002.BIN",), ("00000001.BIN",), ("00000002.BIN",)]


def test_without_a_job_the_directory_is_read_each_21st_turn(worker, monkeypatch, tmp_path):
    reads = []
    monkeypatch.setattr(archive_worker, "log_files", lambda directory: reads.append(directory) or {})
    worker.failure = "log: not compressed: an earlier error"
    for turn in range(43):
        worker.work(0)
        assert len(reads) == 1 + turn // 21
    assert worker.failure == ""
    assert reads[0] == tmp_path


def test_closed_logs_are_compressed_and_read_back_tick_by_tick(tmp_path, fake):
    run = Run(fake, tmp_path, file_bytes=100_000).sail(500).turn(3 * IDLE_TURNS)
    names = log_names(tmp_path)
    assert len(names) > 3
    assert [name.endswith(".gz") for name in names] == [True] * (len(names) - 1) + [False]
    run.recorder.close()
    times = list(itertools.chain.from_iterable(times_of(path) for _, path in sorted(log_files(tmp_path).items())))
    assert times == [pytest.approx(START_S + index) for index in range(500)]
    assert boxes(tmp_path) == []
    assert run.recorder.health(1.0).state is DeviceState.RUNNING


def test_a_restart_makes_a_black_box(tmp_path, fake):
    Run(fake, tmp_path).sail(700).kill()
    run = Run(fake, tmp_path).sail(5).turn(5)
    assert boxes(tmp_path) == ["00000001-end.BIN.gz"]
    times = times_of(tmp_path / "boxes" / "00000001-end.BIN.gz")
    assert times[-1] == pytest.approx(START_S + 699.0)
    assert times[0] == pytest.approx(times[-1] - 300.0)
    run.turn(3 * IDLE_TURNS)
    assert log_names(tmp_path) == ["00000001.BIN.gz", "00000002.BIN"]
    run.recorder.close()


def test_a_missing_box_is_made_after_the_next_start(tmp_path, fake):
    Run(fake, tmp_path).sail(400).kill()
    Run(fake, tmp_path).sail(1).kill()  # too short for a box
    for path in (tmp_path / "boxes").glob("*"):
        path.unlink()
    run = Run(fake, tmp_path).sail(5).turn(100)
    assert boxes(tmp_path) == ["00000001-end.BIN.gz", "00000002-end.BIN.gz"]
    run.recorder.close()


def test_a_disk_error_is_reported_and_retried_while_the_log_continues(tmp_path, fake, monkeypatch):
    run = Run(fake, tmp_path, file_bytes=100_000)
    with monkeypatch.context() as patches:
        patches.setattr(os, "pwrite", fail)
        run.sail(300)
    health = run.recorder.health(1.0)
    assert (health.state, health.text) == (DeviceState.FAULTY, "log: not compressed: No space left on device")
    assert all(name.endswith(".BIN") for name in log_names(tmp_path))
    run.turn(RETRY_TURNS + 60)
    assert run.recorder.health(2.0).state is DeviceState.RUNNING
    assert all(name.endswith(".gz") for name in log_names(tmp_path)[:-1])
    run.recorder.close()


def test_a_closed_file_without_a_tick_is_compressed_without_a_box(tmp_path, fake):
    (tmp_path / "00000001.BIN").write_bytes(b"another program " * 1000)
    run = Run(fake, tmp_path).sail(3).turn(60)
    assert log_names(tmp_path) == ["00000001.BIN.gz", "00000002.BIN"]
    assert boxes(tmp_path) == []
    run.recorder.close()


def test_the_next_tick_is_found_from_any_offset(tmp_path, fake):
    data = fake.write_log(tmp_path, 40)
    mark = b"\xa3\x95" + bytes((schema.TICK.type.number,))
    ticks = [offset for offset in range(len(data)) if data.startswith(mark, offset)]
    assert len(ticks) == 40
    descriptor = os.open(tmp_path / "00000001.BIN", os.O_RDONLY)
    for begin in range(1, len(data), 97):
        tick = find_next_tick(descriptor, begin, len(data))
        expected = next((offset for offset in ticks[1:] if offset >= begin + schema.END.size), None)
        assert (tick and tick.offset) == expected
    assert find_next_tick(descriptor, 0, len(data)).offset == ticks[0]
    os.close(descriptor)
