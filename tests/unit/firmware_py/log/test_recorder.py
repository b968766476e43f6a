import errno
import shutil
import threading
from collections import Counter
from types import SimpleNamespace

import msgspec
import pytest
from pymavlink.DFReader import DFReader_binary

from firmware_py.common.records import DeviceRole, DeviceState, HeadingSample, Inputs, NorthReference, RudderFeedback
from firmware_py.faults.table import TABLE
from firmware_py.log import recorder as recorder_module
from firmware_py.log.dataflash import Parser
from firmware_py.log.disk import LocalDisk, log_files
from firmware_py.log.reader import LogReader


def read_with_pymavlink(path):
    """Return the reader after the last message, and all messages."""
    reader = DFReader_binary(str(path))
    messages = []
    while (message := reader.recv_msg()) is not None:
        messages.append(message)
    return reader, messages


def read_ticks(directory):
    return [tick for _, path in sorted(log_files(directory).items()) for tick in LogReader(path)]


def indexes_of(ticks):
    return [tick.inputs.tick.index for tick in ticks]


def total_bytes(directory):
    return sum(path.stat().st_size for path in log_files(directory).values())


def test_a_new_severe_fault_requests_a_black_box(tmp_path, fake, monkeypatch):
    calls = []
    worker = SimpleNamespace(note_tick=lambda t_s, *, is_severe: calls.append((t_s, is_severe)), failure="")
    monkeypatch.setattr(recorder_module, "ArchiveWorker", lambda _directory: worker)
    recorder = fake.make_recorder(tmp_path)
    inputs = fake.make_inputs(5)
    output = fake.step(fake.State(), inputs)[1]
    severe = {fault for fault, row in TABLE.items() if row.severity.name in ("EMERGENCY", "ALERT", "CRITICAL", "ERROR")}
    assert 0 < len(severe) < len(TABLE)
    for fault in TABLE:
        for faults in (0, 1 << fault, 1 << fault):
            snapshot = msgspec.structs.replace(output.snapshot, faults=faults)
            recorder.offer(inputs, msgspec.structs.replace(output, snapshot=snapshot), lambda: "{}")
        assert [is_severe for _, is_severe in calls[-3:]] == [False, fault in severe, False], fault
    assert calls[0][0] == inputs.tick.t_s
    recorder.close()


def test_pymavlink_reads_the_messages_with_values_and_units(tmp_path, fake, capfd):
    fake.write_log(tmp_path)
    reader, messages = read_with_pymavlink(tmp_path / "00000001.BIN")
    counts = Counter(message.get_type() for message in messages)
    expected = {"TICK": 6, "HDG": 12, "FIX": 6, "GPS": 3, "RFB": 12, "CTL": 6, "NAV": 6, "END": 6, "MODE": 2}
    assert {name: counts[name] for name in expected} == expected
    assert {"DEV", "REQ", "CHK", "MSG", "PARM"} <= counts.keys()
    output = capfd.readouterr()
    assert (output.out, output.err) == ("", "")  # it prints errors

    heading = next(message for message in messages if message.get_type() == "HDG")
    assert (heading.T, heading.Hdg, heading.Var, heading.Roll) == (fake.make_inputs(0).headings[0].t_s, 1.0, -0.1, 0.02)
    assert heading.YawR != heading.YawR
    units = {"TimeUS": "µs", "I": "instance", "Hdg": "rad", "YawR": "rad/s", "Temp": "degC", "Ref": ""}
    assert {label: heading.fmt.get_unit(label) for label in units} == units
    position = next(message for message in messages if message.get_type() == "GPS")
    assert position.Lat == pytest.approx(45.8366236)
    assert position.fmt.get_unit("Lat") == "deglatitude"
    # The reader's clock is UTC from the first fix with UTC on: tick 1 was at 1.7e9 + 1 s.
    assert position._timestamp == pytest.approx(1.7e9 + 1.0, abs=0.01)
    assert [name for name, _, _ in reader.flightmode_list()][-1] == "GUIDED"
    assert reader.param("RUD_LIMIT_DEG") == 30.0
    changes = [message.Value for message in messages if message.get_type() == "PARM" and message.Name == "CTL_K1"]
    assert changes == [40.0, 12.5]
    reader.close()


def test_every_input_is_read_back_with_one_checkpoint_at_the_start(tmp_path, fake):
    recorder = fake.make_recorder(tmp_path)
    _, run = fake.run_ticks(recorder, range(6))
    recorder.close()
    ticks = read_ticks(tmp_path)
    assert [(tick.inputs, tick.command) for tick in ticks] == [(inputs, output.command) for inputs, output in run]
    assert repr([tick.inputs for tick in ticks]) == repr([inputs for inputs, _ in run])
    assert [tick.checkpoint is not None for tick in ticks] == [True] + [False] * 5
    assert fake.state_from(ticks[0].checkpoint) == fake.State()
    assert not any(tick.gap for tick in ticks)


def test_held_ticks_are_written_as_the_same_bytes_and_none_is_lost_at_the_end(tmp_path, fake):
    results = {}
    for name in ("at once", "held"):
        recorder = fake.make_recorder(tmp_path / name)
        counts = []

        def count(recorder=recorder, counts=counts, at_once=name == "at once"):
            if at_once:
                recorder._queue_held_ticks()
            recorder.writer.drain()
            counts.append(recorder.health(0.0).accepted)

        fake.run_ticks(recorder, range(4, 17), after_tick=count, rate_hz=10.0)
        recorder.close()
        results[name] = counts, (tmp_path / name / "00000001.BIN").read_bytes()
    assert results["at once"][0] == list(range(1, 14))
    assert results["held"][0] == [*(0,) * 4, *(5,) * 5, *(10,) * 4]
    assert results["held"][1] == results["at once"][1]
    assert len(read_ticks(tmp_path / "held")) == 13


def test_a_tick_with_a_request_or_an_event_is_not_held_nor_are_those_before(tmp_path, fake):
    recorder = fake.make_recorder(tmp_path)
    accepted = []
    # Tick 1 has requests and an event, tick 3 a request.
    fake.run_ticks(recorder, range(5), after_tick=lambda: accepted.append(recorder.health(0.0).accepted), rate_hz=50.0)
    assert accepted == [0, 2, 2, 4, 4]
    recorder.close()
    assert len(read_ticks(tmp_path)) == 5


@pytest.mark.parametrize(("rate_hz", "max_held"), [(1.0, 1), (2.0, 1), (4.0, 2), (10.0, 5), (50.0, 5)])
def test_ticks_are_held_for_at_most_half_a_second(tmp_path, fake, rate_hz, max_held):
    recorder = fake.make_recorder(tmp_path)
    for count in range(max_held):
        assert recorder.health(0.0).accepted == 0
        fake.run_ticks(recorder, [4 + count], rate_hz=rate_hz)
    assert recorder.health(0.0).accepted == max_held


def test_files_change_between_ticks_and_the_oldest_is_removed(tmp_path, fake):
    recorder = fake.make_recorder(tmp_path, file_bytes=12_000, max_total_bytes=50_000)
    _, run = fake.run_ticks(recorder, range(100), after_tick=recorder.writer.drain)
    recorder.close()
    numbers = sorted(log_files(tmp_path))
    assert numbers[0] > 1
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert total_bytes(tmp_path) <= 50_000 + 4_000  # one or two ticks more
    inputs = [tick.inputs for tick in read_ticks(tmp_path)]
    assert inputs == [inputs for inputs, _ in run][-len(inputs) :]
    for path in log_files(tmp_path).values():
        checkpoints = [tick.checkpoint is not None for tick in LogReader(path)]
        assert checkpoints == [True] + [False] * (len(checkpoints) - 1)
    assert recorder.health(1.0).rejected == 0


def test_a_full_queue_drops_and_counts_ticks_and_continues_with_a_checkpoint(tmp_path, fake):
    class SlowDisk(LocalDisk):
        entered, release, synced = threading.Event(), threading.Event(), threading.Semaphore(0)

        def write(self, descriptor, data):
            self.entered.set()
            assert self.release.wait(60.0)
            return super().write(descriptor, data)

        def sync(self, descriptor):
            super().sync(descriptor)
            self.synced.release()

    disk = SlowDisk()
    recorder = fake.make_recorder(tmp_path, background=True, disk=disk, queue_batches=4)
    state, _ = fake.run_ticks(recorder, range(1))
    recorder.writer._wake.set()
    assert disk.entered.wait(60.0)  # the writer is blocked in the first write
    state, _ = fake.run_ticks(recorder, range(1, 5), state)  # the queue is full
    assert recorder.health(1.0).state is not DeviceState.FAULTY
    state, _ = fake.run_ticks(recorder, range(5, 10), state)  # five are dropped
    health = recorder.health(5.0)
    assert (health.role, health.state, health.rejected) == (DeviceRole.STORAGE, DeviceState.FAULTY, 5)
    assert "too slow" in health.text
    disk.release.set()
    for _ in ("the first tick", "the queue"):
        assert disk.synced.acquire(timeout=60.0)
    fake.run_ticks(recorder, range(10, 13), state)
    recorder.close()
    ticks = read_ticks(tmp_path)
    assert indexes_of(ticks) == [0, 1, 2, 3, 4, 10, 11, 12]
    assert [tick.gap for tick in ticks] == [False] * 5 + [True, False, False]
    assert fake.state_from(ticks[5].checkpoint) == state
    health = recorder.health(6.0)
    assert (health.state, health.accepted, health.rejected, health.text) == (DeviceState.RUNNING, 8, 5, "")
    reader, messages = read_with_pymavlink(tmp_path / "00000001.BIN")
    assert [message.Lost for message in messages if message.get_type() == "DROP"] == [5]
    reader.close()


def test_after_a_full_disk_a_new_file_starts_with_a_checkpoint(tmp_path, fake):
    class FullDisk(LocalDisk):
        is_full = False

        def write(self, descriptor, data):
            if self.is_full:
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(descriptor, data)

    disk = FullDisk()
    recorder = fake.make_recorder(tmp_path, disk=disk)
    state, _ = fake.run_ticks(recorder, range(3), after_tick=recorder.writer.drain)
    assert recorder.health(0.3).state is DeviceState.RUNNING
    disk.is_full = True
    state, _ = fake.run_ticks(recorder, range(3, 6), state, after_tick=recorder.writer.drain)
    health = recorder.health(0.6)
    assert (health.state, health.rejected, health.text) == (DeviceState.FAULTY, 3, "log: No space left on device")
    disk.is_full = False
    fake.run_ticks(recorder, range(6, 9), state, after_tick=recorder.writer.drain)
    assert recorder.health(0.9).state is DeviceState.RUNNING
    recorder.close()
    files = [list(LogReader(path)) for path in sorted(tmp_path.glob("*.BIN"))]
    assert [indexes_of(ticks) for ticks in files] == [[0, 1, 2], [6, 7, 8]]
    assert fake.state_from(files[1][0].checkpoint) == state


def test_a_removed_directory_is_created_again(tmp_path, fake):
    directory = tmp_path / "logs"
    recorder = fake.make_recorder(directory)
    state, _ = fake.run_ticks(recorder, range(2), after_tick=recorder.writer.drain)
    shutil.rmtree(directory)
    state, _ = fake.run_ticks(recorder, range(2, 3), state, after_tick=recorder.writer.drain)
    assert recorder.health(1.0).state is DeviceState.FAULTY
    fake.run_ticks(recorder, range(3, 5), state, after_tick=recorder.writer.drain)
    recorder.close()
    assert recorder.health(2.0).state is DeviceState.RUNNING
    assert indexes_of(read_ticks(directory)) == [3, 4]


def test_an_unwritable_directory_is_a_fault_and_no_exception(tmp_path, fake):
    (tmp_path / "file").write_text("not a directory")
    recorder = fake.make_recorder(tmp_path / "file")
    assert recorder.health(0.0).state is DeviceState.STARTING
    fake.run_ticks(recorder, range(3), after_tick=recorder.writer.drain)
    recorder.close()
    health = recorder.health(1.0)
    assert (health.state, health.accepted, health.rejected) == (DeviceState.FAULTY, 0, 3)
    assert health.text.startswith("log: ")


def test_closed_logs_have_the_total_size_less_one_file_and_ticks_are_written_each_second(tmp_path, fake, monkeypatch):
    writers = []
    monkeypatch.setattr(recorder_module, "LogWriter", lambda *_words, **options: writers.append(options))
    fake.make_recorder(tmp_path, file_bytes=300, max_total_bytes=1000, min_free_bytes=7)
    fake.make_recorder(tmp_path, file_bytes=600, max_total_bytes=1000, wait_for_disk=True)
    names = ("max_log_bytes", "min_free_bytes", "flush_s", "queue_batches", "queue_bytes", "wait_for_disk")
    assert [[options[name] for name in names] for options in writers] == [
        [700, 7, 1.0, 2048, 4_194_304, False], [500, 0, 1.0, 2048, 4_194_304, True]
    ]  # fmt: skip


def test_the_health_names_a_dead_writer_and_a_nearly_full_disk(tmp_path, fake):
    recorder = fake.make_recorder(tmp_path)
    writer = recorder.writer
    writer.is_alive = lambda: False
    health = recorder.health(1.0)
    assert (health.t_s, health.state, health.text) == (1.0, DeviceState.FAULTY, "log: the writer has ended")
    writer.failure = "log: x"
    assert recorder.health(1.0).text == "log: x"
    writer.low_space = True
    assert (recorder.health(1.0).state, recorder.health(1.0).text) == (DeviceState.FULL, "log: x")
    writer.is_alive, writer.failure = lambda: True, ""
    assert (recorder.health(1.0).state, recorder.health(1.0).text) == (DeviceState.FULL, "log: the disk is nearly full")


def test_a_tick_that_does_not_fit_the_format_is_dropped_and_the_next_has_a_checkpoint(tmp_path, fake):
    recorder = fake.make_recorder(tmp_path)
    state, run = fake.run_ticks(recorder, range(2))
    inputs, output = run[-1]
    bits = RudderFeedback(1.0, hardware_error=1 << 40)
    angle = HeadingSample(1.0, None, NorthReference.TRUE)
    recorder.offer(Inputs(inputs.tick, rudder=(bits,)), output, lambda: "not used")
    recorder.offer(Inputs(inputs.tick, headings=(angle,)), output, lambda: "checkpoint")
    assert recorder.health(1.0).state is DeviceState.FAULTY

    def fail():
        raise ValueError("x" * 200)

    recorder.offer(inputs, output, fail)
    assert recorder.health(1.0).text == f"log: a tick cannot be written: {'x' * 200}"[:100]
    fake.run_ticks(recorder, range(2, 4), state)
    recorder.close()
    ticks = read_ticks(tmp_path)
    assert indexes_of(ticks) == [0, 1, 2, 3]
    data = (tmp_path / "00000001.BIN").read_bytes()
    assert sum(record.name == "THR" for record, _ in Parser(data)) == 2  # all values in ticks 0 and 2
    assert [tick.gap for tick in ticks] == [False, False, True, False]
    assert fake.state_from(ticks[2].checkpoint) == state
    assert (recorder.health(1.0).rejected, recorder.health(1.0).state) == (3, DeviceState.RUNNING)
