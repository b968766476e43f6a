import errno
import shutil
import threading

import pytest
from pymavlink.DFReader import DFReader_binary

from firmware_py.common.records import DeviceRole, DeviceState, HeadingSample, Inputs, NorthReference, RudderFeedback
from firmware_py.log.disk import LocalDisk, log_files
from firmware_py.log.reader import LogReader


def read_with_pymavlink(path):
    reader = DFReader_binary(str(path))
    messages = []
    while (message := reader.recv_msg()) is not None:
        messages.append(message)
    return reader, messages


def inputs_in(directory):
    return [tick.inputs for path in sorted(directory.glob("*.BIN")) for tick in LogReader(path)]


def test_pymavlink_opens_all_of_it(tmp_path, pretend, capfd):
    pretend.logged(tmp_path)
    reader, messages = read_with_pymavlink(tmp_path / "00000001.BIN")
    counted = {name: sum(one.get_type() == name for one in messages) for name in {one.get_type() for one in messages}}
    assert {name: counted.get(name) for name in ("TICK", "HDG", "FIX", "GPS", "RFB", "CTL", "NAV", "END")} == {
        "TICK": 6,
        "HDG": 12,
        "FIX": 6,
        "GPS": 3,
        "RFB": 12,
        "CTL": 6,
        "NAV": 6,
        "END": 6,
    }
    assert {"DEV", "REQ", "CHK", "MSG", "MODE", "PARM"} <= counted.keys()
    reader.close()
    output = capfd.readouterr()
    assert (output.out, output.err) == ("", "")  # it complains on the terminal


def test_pymavlink_reads_the_values_and_units(tmp_path, pretend):
    pretend.logged(tmp_path)
    reader, messages = read_with_pymavlink(tmp_path / "00000001.BIN")
    heading = next(one for one in messages if one.get_type() == "HDG")
    sample = pretend.inputs_of(0).headings[0]
    assert (heading.T, heading.Hdg, heading.Var, heading.Roll) == (sample.t_s, 1.0, -0.1, 0.02)
    assert heading.YawR != heading.YawR
    assert [heading.fmt.get_unit(label) for label in ("TimeUS", "I", "Hdg", "YawR", "Temp", "Ref")] == [
        "µs",
        "instance",
        "rad",
        "rad/s",
        "degC",
        "",
    ]
    position = next(one for one in messages if one.get_type() == "GPS")
    assert position.Lat == pytest.approx(45.8366236)
    assert position.fmt.get_unit("Lat") == "deglatitude"
    # The clock of the log is UTC as soon as a fix says it: tick 1 was at 1.7e9 + 1 s.
    assert position._timestamp == pytest.approx(1.7e9 + 1.0, abs=0.01)
    assert [name for name, _, _ in reader.flightmode_list()][-1] == "GUIDED"
    assert reader.param("RUD_LIMIT_DEG") == 30.0
    reader.close()


def test_a_parameter_that_is_set_is_logged(tmp_path, pretend):
    pretend.logged(tmp_path)
    reader, messages = read_with_pymavlink(tmp_path / "00000001.BIN")
    assert [one.Value for one in messages if one.get_type() == "PARM" and one.Name == "CTL_K1"] == [40.0, 12.5]
    reader.close()


def test_every_input_is_read_back_and_one_checkpoint_stands_at_the_start(tmp_path, pretend):
    recorder = pretend.recorder_in(tmp_path)
    _, sailed = pretend.sail(recorder, range(6))
    recorder.close()
    ticks = list(LogReader(tmp_path / "00000001.BIN"))
    assert [(tick.inputs, tick.command) for tick in ticks] == [(inputs, output.command) for inputs, output in sailed]
    assert repr([tick.inputs for tick in ticks]) == repr([inputs for inputs, _ in sailed])
    assert [tick.checkpoint is not None for tick in ticks] == [True] + [False] * 5
    assert pretend.state_from(ticks[0].checkpoint) == pretend.State()
    assert not any(tick.gap for tick in ticks)


def test_ticks_are_packed_a_few_at_a_time_to_the_same_bytes_and_none_is_lost_at_the_end(tmp_path, pretend):
    written = []
    for name in ("at once", "together"):
        recorder = pretend.recorder_in(tmp_path / name)
        counts = []

        def look(recorder=recorder, counts=counts, at_once=name == "at once"):
            if at_once:
                recorder._pack_held()
            recorder.writer.drain()
            counts.append(recorder.health(0.0).accepted)

        pretend.sail(recorder, range(4, 17), after=look, rate_hz=10.0)
        recorder.close()
        written.append((counts, (tmp_path / name / "00000001.BIN").read_bytes()))
    (each, bytes_at_once), (held, bytes_together) = written
    assert each == list(range(1, 14))
    assert held == [*(0,) * 4, *(5,) * 5, *(10,) * 4]
    assert bytes_together == bytes_at_once
    assert len(list(LogReader(tmp_path / "together" / "00000001.BIN"))) == 13


def test_a_tick_with_a_request_or_an_event_is_not_held_nor_are_those_before(tmp_path, pretend):
    recorder = pretend.recorder_in(tmp_path)
    accepted = []
    # Tick 1 has requests and an event, tick 3 a request.
    pretend.sail(recorder, range(5), after=lambda: accepted.append(recorder.health(0.0).accepted), rate_hz=50.0)
    assert accepted == [0, 2, 2, 4, 4]
    recorder.close()
    assert len(list(LogReader(tmp_path / "00000001.BIN"))) == 5


@pytest.mark.parametrize(("rate_hz", "longest"), [(1.0, 1), (2.0, 1), (4.0, 2), (10.0, 5), (50.0, 5)])
def test_a_slow_loop_holds_fewer_ticks_never_half_a_second(tmp_path, pretend, rate_hz, longest):
    recorder = pretend.recorder_in(tmp_path)
    for count in range(longest):
        assert recorder.health(0.0).accepted == 0
        pretend.sail(recorder, [4 + count], rate_hz=rate_hz)
    assert recorder.health(0.0).accepted == longest


def test_files_change_at_a_tick_and_the_oldest_goes(tmp_path, pretend):
    recorder = pretend.recorder_in(tmp_path, file_bytes=12_000, max_total_bytes=50_000)
    _, sailed = pretend.sail(recorder, range(100), after=recorder.writer.drain)
    recorder.close()
    numbers = sorted(log_files(tmp_path))
    assert numbers[0] > 1
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert sum(path.stat().st_size for path in log_files(tmp_path).values()) <= 50_000 + 4_000  # a tick or two over
    kept = inputs_in(tmp_path)
    assert kept == [inputs for inputs, _ in sailed][-len(kept) :]
    for path in log_files(tmp_path).values():
        ticks = list(LogReader(path))
        assert ticks[0].checkpoint is not None
        assert [tick.checkpoint for tick in ticks[1:]] == [None] * (len(ticks) - 1)
    assert recorder.health(1.0).rejected == 0


def test_a_file_is_at_most_half_of_what_is_kept(tmp_path, pretend):
    recorder = pretend.recorder_in(tmp_path, file_bytes=1 << 30, max_total_bytes=24_000)
    pretend.sail(recorder, range(60), after=recorder.writer.drain)
    recorder.close()
    assert len(log_files(tmp_path)) in (1, 2)
    assert sum(path.stat().st_size for path in log_files(tmp_path).values()) <= 24_000 + 4_000


def test_the_queue_full_drops_whole_ticks_counts_them_and_goes_on_with_a_checkpoint(tmp_path, pretend):
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
    recorder = pretend.recorder_in(tmp_path, background=True, disk=disk, queue_batches=4)
    state, _ = pretend.sail(recorder, range(1))
    recorder.writer._wake.set()
    assert disk.entered.wait(60.0)  # the writer hangs in the first write
    state, _ = pretend.sail(recorder, range(1, 5), state)  # the queue is full
    assert recorder.health(1.0).state is not DeviceState.FAULTY
    state, _ = pretend.sail(recorder, range(5, 10), state)  # five are dropped
    health = recorder.health(5.0)
    assert (health.role, health.state, health.rejected) == (DeviceRole.STORAGE, DeviceState.FAULTY, 5)
    assert "too slow" in health.text
    disk.release.set()
    assert disk.synced.acquire(timeout=60.0)  # the first tick
    assert disk.synced.acquire(timeout=60.0)  # and the queue
    expected = state
    state, _ = pretend.sail(recorder, range(10, 13), state)
    recorder.close()
    ticks = list(LogReader(tmp_path / "00000001.BIN"))
    assert [tick.inputs.tick.index for tick in ticks] == [0, 1, 2, 3, 4, 10, 11, 12]
    assert [tick.gap for tick in ticks] == [False] * 5 + [True, False, False]
    assert pretend.state_from(ticks[5].checkpoint) == expected
    health = recorder.health(6.0)
    assert (health.state, health.accepted, health.rejected, health.text) == (DeviceState.RUNNING, 8, 5, "")
    reader, messages = read_with_pymavlink(tmp_path / "00000001.BIN")
    assert [one.Lost for one in messages if one.get_type() == "DROP"] == [5]
    reader.close()


def test_a_full_disk_is_survived(tmp_path, pretend):
    class FullDisk(LocalDisk):
        full = False

        def write(self, descriptor, data):
            if self.full:
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(descriptor, data)

    disk = FullDisk()
    recorder = pretend.recorder_in(tmp_path, disk=disk)
    state, _ = pretend.sail(recorder, range(3), after=recorder.writer.drain)
    assert recorder.health(0.3).state is DeviceState.RUNNING
    disk.full = True
    state, _ = pretend.sail(recorder, range(3, 6), state, after=recorder.writer.drain)
    health = recorder.health(0.6)
    assert (health.state, health.rejected, health.text) == (DeviceState.FAULTY, 3, "log: No space left on device")
    disk.full = False
    pretend.sail(recorder, range(6, 9), state, after=recorder.writer.drain)
    assert recorder.health(0.9).state is DeviceState.RUNNING
    recorder.close()
    files = [list(LogReader(path)) for path in sorted(tmp_path.glob("*.BIN"))]
    assert [[tick.inputs.tick.index for tick in ticks] for ticks in files] == [[0, 1, 2], [6, 7, 8]]
    assert pretend.state_from(files[1][0].checkpoint) == state


def test_a_directory_that_vanishes_is_made_again(tmp_path, pretend):
    directory = tmp_path / "logs"
    recorder = pretend.recorder_in(directory)
    state, _ = pretend.sail(recorder, range(2), after=recorder.writer.drain)
    shutil.rmtree(directory)
    state, _ = pretend.sail(recorder, range(2, 3), state, after=recorder.writer.drain)
    assert recorder.health(1.0).state is DeviceState.FAULTY
    pretend.sail(recorder, range(3, 5), state, after=recorder.writer.drain)
    recorder.close()
    assert recorder.health(2.0).state is DeviceState.RUNNING
    assert [inputs.tick.index for inputs in inputs_in(directory)] == [3, 4]


def test_an_unwritable_directory_is_a_fault_and_not_an_exception(tmp_path, pretend):
    (tmp_path / "file").write_text("not a directory")
    recorder = pretend.recorder_in(tmp_path / "file")
    assert recorder.health(0.0).state is DeviceState.STARTING
    pretend.sail(recorder, range(3), after=recorder.writer.drain)
    recorder.close()
    health = recorder.health(1.0)
    assert (health.state, health.accepted, health.rejected) == (DeviceState.FAULTY, 0, 3)
    assert health.text.startswith("log: ")


def test_a_tick_that_does_not_fit_the_format_is_dropped_and_the_next_has_a_checkpoint(tmp_path, pretend):
    recorder = pretend.recorder_in(tmp_path)
    state, sailed = pretend.sail(recorder, range(2))
    inputs, output = sailed[-1]
    bits = RudderFeedback(1.0, hardware_error=1 << 40)
    angle = HeadingSample(1.0, None, NorthReference.TRUE)
    recorder.offer(Inputs(inputs.tick, rudder=(bits,)), output, lambda: "never asked for")
    recorder.offer(Inputs(inputs.tick, headings=(angle,)), output, lambda: "checkpoint")
    assert recorder.health(1.0).state is DeviceState.FAULTY
    pretend.sail(recorder, range(2, 4), state)
    recorder.close()
    ticks = list(LogReader(tmp_path / "00000001.BIN"))
    assert [tick.inputs.tick.index for tick in ticks] == [0, 1, 2, 3]
    assert [tick.gap for tick in ticks] == [False, False, True, False]
    assert pretend.state_from(ticks[2].checkpoint) == state
    assert (recorder.health(1.0).rejected, recorder.health(1.0).state) == (2, DeviceState.RUNNING)
