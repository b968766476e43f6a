"""What is kept of months: closed logs compressed, the minutes before restarts and severe faults cut out."""

import itertools
import os

import msgspec
import pytest

from firmware_py.common.records import DeviceState
from firmware_py.faults.table import Fault
from firmware_py.log import schema
from firmware_py.log.archive_worker import IDLE_TURNS, RETRY_TURNS
from firmware_py.log.black_box import box_path, make_box, next_tick
from firmware_py.log.disk import log_files
from firmware_py.log.reader import LogReader

TICK_S = 0.1


class Run:
    """A start of the program: ticks are offered, and the writer's turns are taken by hand, a second each."""

    def __init__(self, pretend, directory, **options):
        self.pretend = pretend
        self.recorder = pretend.recorder_in(directory, clock_utc_s=lambda: 1.8e9, **options)
        self.state, self.index, self.reports = pretend.State(), 0, []

    def sail(self, seconds, faults=0, *, every=1.0):
        """Let `every` seconds be a tick, so that minutes are few of them."""
        for _ in range(round(seconds / every)):
            inputs = self.pretend.inputs_of(self.index)
            t_s = 12.3 + self.index * every
            inputs = msgspec.structs.replace(inputs, tick=msgspec.structs.replace(inputs.tick, t_s=t_s), requests=())
            before, (self.state, output) = self.state, self.pretend.step(self.state, inputs)
            snapshot = msgspec.structs.replace(output.snapshot, faults=faults, t_s=t_s)
            output = msgspec.structs.replace(output, snapshot=snapshot)
            self.recorder.offer(inputs, output, lambda state=before: self.pretend.to_text(state))
            self.index += 1
            self.turn()
        return self

    def turn(self, count=1):
        for _ in range(count):
            writer = self.recorder.writer
            before = writer._taken_bytes
            writer.drain()
            self.recorder._do_background_work(writer._taken_bytes - before)
        return self

    def kill(self):
        """Leave it as a kill does, once its last second is on disk."""
        self.turn()
        if self.recorder.writer._file is not None:
            os.close(self.recorder.writer._file[0])
        self.recorder._thin_file.close()


def times_of(path):
    return [tick.inputs.tick.t_s for tick in LogReader(path)]


def boxes(directory):
    return sorted(path.name for path in (directory / "boxes").glob("*"))


def test_closed_logs_are_compressed_and_read_back_tick_by_tick(tmp_path, pretend):
    run = Run(pretend, tmp_path, file_bytes=100_000).sail(500.0)
    run.turn(3 * IDLE_TURNS)
    names = [path.name for path in log_files(tmp_path).values()]
    assert len(names) > 3
    assert [name.endswith(".gz") for name in names] == [True] * (len(names) - 1) + [False]
    run.recorder.close()
    times = list(itertools.chain.from_iterable(times_of(path) for _, path in sorted(log_files(tmp_path).items())))
    assert times == [pytest.approx(12.3 + index) for index in range(500)]
    assert boxes(tmp_path) == []
    assert run.recorder.health(1.0).state is DeviceState.RUNNING


def test_a_restart_of_any_kind_makes_a_black_box(tmp_path, pretend):
    Run(pretend, tmp_path).sail(700.0).kill()
    run = Run(pretend, tmp_path).sail(5.0)
    run.turn(5)
    assert boxes(tmp_path) == ["00000001-end.BIN.gz"]
    times = times_of(tmp_path / "boxes" / "00000001-end.BIN.gz")
    assert times[-1] == pytest.approx(12.3 + 699.0)
    assert times[0] == pytest.approx(times[-1] - 300.0)
    run.turn(3 * IDLE_TURNS)
    assert [path.name for path in log_files(tmp_path).values()] == ["00000001.BIN.gz", "00000002.BIN"]
    run.recorder.close()


def test_a_box_of_a_short_file_includes_the_end_of_the_previous_one(tmp_path, pretend):
    run = Run(pretend, tmp_path, file_bytes=350_000).sail(300.0)
    while run.recorder._opened_files and len(log_files(tmp_path)) < 2:
        run.sail(10.0)
    last = run.index
    run.kill()
    (tmp_path / "00000001.BIN").rename(tmp_path / "kept")  # not compressed yet, as after a quick restart
    for path in tmp_path.glob("00000001.BIN*"):
        path.unlink()
    (tmp_path / "kept").rename(tmp_path / "00000001.BIN")
    for _ in make_box(tmp_path / "00000002.BIN", "end"):
        pass
    times = times_of(box_path(tmp_path / "00000002.BIN", "end"))
    assert len(times) in (300, 301)  # the first one stands on the edge, to the last bit
    assert times == [pytest.approx(12.3 + index) for index in range(last - len(times), last)]


def test_a_missing_box_is_made_after_the_next_start(tmp_path, pretend):
    Run(pretend, tmp_path).sail(400.0).kill()
    Run(pretend, tmp_path).sail(1.0).kill()  # no time for anything
    for path in (tmp_path / "boxes").glob("*"):
        path.unlink()
    run = Run(pretend, tmp_path).sail(5.0)
    run.turn(100)
    assert boxes(tmp_path) == ["00000001-end.BIN.gz", "00000002-end.BIN.gz"]
    run.recorder.close()


def test_only_a_severe_fault_makes_a_black_box(tmp_path, pretend):
    slight, severe = 1 << Fault.POSITION_LOST, 1 << Fault.COMPASS_LOST
    run = Run(pretend, tmp_path).sail(400.0).sail(50.0, slight)
    assert boxes(tmp_path) == []
    run.sail(60.0, severe | slight)
    event_s = 12.3 + 450.0
    (name,) = boxes(tmp_path)
    assert name == f"00000001-{event_s:.0f}.BIN.gz"
    times = times_of(tmp_path / "boxes" / name)
    assert (times[0], times[-1]) == (pytest.approx(event_s - 300.0), pytest.approx(event_s + 29.0))
    run.sail(10.0).sail(10.0, severe).sail(60.0)  # again within ten minutes: half of it is in the first box
    assert boxes(tmp_path) == [name]
    run.sail(500.0).sail(60.0, severe)
    assert len(boxes(tmp_path)) == 2
    run.recorder.close()


def test_a_disk_error_is_reported_and_retried_while_the_log_continues(tmp_path, pretend, monkeypatch):
    run = Run(pretend, tmp_path, file_bytes=100_000)
    real = os.pwrite

    def fail(*_words):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "pwrite", fail)
    run.sail(300.0)
    health = run.recorder.health(1.0)
    assert (health.state, health.text) == (DeviceState.FAULTY, "log: not compressed: No space left on device")
    assert all(path.suffix == ".BIN" for path in log_files(tmp_path).values())
    monkeypatch.setattr(os, "pwrite", real)
    run.turn(RETRY_TURNS + 60)
    assert run.recorder.health(2.0).state is DeviceState.RUNNING
    assert {path.suffix for path in list(log_files(tmp_path).values())[:-1]} == {".gz"}
    run.recorder.close()


def test_a_failure_is_cleared_when_nothing_is_left_to_do(tmp_path, pretend, monkeypatch):
    """As when it had no room for the minutes around a fault: the next log to be compressed may be days away."""
    run = Run(pretend, tmp_path).sail(400.0)

    def fail(*_words):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as broken:
        broken.setattr(os, "pwrite", fail)
        run.sail(60.0, 1 << Fault.COMPASS_LOST)
    assert run.recorder.health(1.0).state is DeviceState.FAULTY
    run.turn(RETRY_TURNS + 1)
    assert run.recorder.health(2.0).state is DeviceState.RUNNING
    run.recorder.close()


def test_a_closed_file_without_a_tick_is_compressed_without_a_box(tmp_path, pretend):
    (tmp_path / "00000001.BIN").write_bytes(b"another program " * 1000)
    run = Run(pretend, tmp_path).sail(3.0)
    run.turn(60)
    assert [path.name for path in log_files(tmp_path).values()] == ["00000001.BIN.gz", "00000002.BIN"]
    assert boxes(tmp_path) == []
    run.recorder.close()


def test_a_tick_is_found_from_any_offset(tmp_path, pretend):
    data = pretend.logged(tmp_path, 40)
    mark = b"\xa3\x95" + bytes((schema.TICK.type.number,))
    places = [at for at in range(len(data)) if data.startswith(mark, at)]
    assert len(places) == 40
    descriptor = os.open(tmp_path / "00000001.BIN", os.O_RDONLY)
    for begin in range(1, len(data), 97):
        found = next_tick(descriptor, begin, len(data))
        expected = next((place for place in places[1:] if place >= begin + schema.END.size), None)
        assert (found and found.offset) == expected
    assert next_tick(descriptor, 0, len(data)).offset == places[0]
    os.close(descriptor)
