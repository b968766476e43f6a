"""The thin log: a row a minute, one at each event, and a bound on how much of that there can be."""

import math
import os

import msgspec
import pytest
from pymavlink.DFReader import DFReader_binary

from firmware_py.common.records import Event, Severity
from firmware_py.common.reports import Energy, Flow, Power
from firmware_py.faults.table import Fault
from firmware_py.log import ardupilot, thin_file
from firmware_py.log.dataflash import header
from firmware_py.log.disk import log_files
from firmware_py.log.thin import HEAD, MAX_BURST_ROWS, ThinLog
from firmware_py.log.thin_file import ThinFile
from support.faulty_disk import KINDS, FaultyDisk

UTC_S = 1.8e9


def outputs(pretend, times_s, **changes):
    """Ticks of the pretend autopilot at these times; `changes` are fields of the snapshot, perhaps by time."""
    state = pretend.State()
    for t_s in times_s:
        inputs = pretend.inputs_of(2)
        inputs = msgspec.structs.replace(inputs, tick=msgspec.structs.replace(inputs.tick, t_s=t_s), devices=())
        state, output = pretend.step(state, inputs)
        values = {name: value(t_s) if callable(value) else value for name, value in changes.items()}
        events = values.pop("events", ())
        snapshot = msgspec.structs.replace(output.snapshot, t_s=t_s, **{"faults": 0, **values})
        yield inputs, msgspec.structs.replace(output, snapshot=snapshot, events=events)


def rows_of(log, ticks):
    return b"".join(log.update(inputs, output) for inputs, output in ticks)


def messages(tmp_path, data, kind):
    path = tmp_path / "read.BIN"
    path.write_bytes(data)
    reader = DFReader_binary(str(path))
    found = []
    while (message := reader.recv_msg()) is not None:
        if message.get_type() == kind:
            found.append(message)
    reader.close()
    return found


def test_a_row_a_minute_sums_up_what_was_since_the_one_before(tmp_path, pretend):
    log = ThinLog(lambda: UTC_S)
    error_rad = {True: 0.1, False: -0.3}
    data = rows_of(
        log,
        outputs(
            pretend,
            range(601),
            heading_error_rad=lambda t_s: error_rad[t_s % 2 == 0],
            energy=lambda t_s: Energy(travel_rad=0.01 * t_s, energy_j=2.0 * t_s),
            skipped_total=lambda t_s: t_s // 30,
        ),
    )
    sailing, upkeep = (messages(tmp_path, HEAD + data, kind) for kind in ("THIN", "THNE"))
    assert len(sailing) == len(upkeep) == 11  # the first tick, and ten minutes
    for row, more in zip(sailing[1:], upkeep[1:], strict=True):
        assert (row.Utc, row.Sec, row.Arm, row.Flt) == (UTC_S, 60.0, 0, 0)
        assert row.Err == pytest.approx(-0.1, abs=0.01)
        assert row.Rms == pytest.approx(math.sqrt(0.05), abs=0.01)
        assert row.Trv == pytest.approx(0.6)
        assert more.Enr == pytest.approx(120.0)
        assert more.Skip == 2
        assert math.isnan(row.Lat)
        assert math.isnan(more.BatV)  # not measured yet


def test_a_row_has_the_mean_powers_of_its_minute_where_they_are_measured(tmp_path, pretend):
    def power(t_s):
        # Panels from 90 s on; a minute of which half is measured has the mean of that half.
        sun, taken = Flow(20.0 * max(0.0, t_s - 90.0), max(0.0, t_s - 90.0)), Flow(5.0 * t_s, t_s)
        return Power(12.5, -1.0, 0.8, solar_w=99.0, solar=sun, load=taken, charged=Flow(0.0, t_s), discharged=taken)

    data = rows_of(ThinLog(lambda: UTC_S), outputs(pretend, range(181), power=power))
    rows = messages(tmp_path, HEAD + data, "THNE")[1:]
    assert [row.Load for row in rows] == [pytest.approx(5.0)] * 3
    assert [row.BatV * row.BatA for row in rows] == [pytest.approx(-5.0)] * 3
    assert [row.SoC for row in rows] == [pytest.approx(0.8)] * 3
    assert math.isnan(rows[0].Sun)
    assert [row.Sun for row in rows[1:]] == [pytest.approx(20.0)] * 2


def test_modes_and_faults_have_a_row_at_once_and_a_fault_within_a_minute_is_not_missed(tmp_path, pretend):
    bit = 1 << Fault.COMPASS_LOST
    log = ThinLog(lambda: UTC_S)
    data = rows_of(log, outputs(pretend, range(80), faults=lambda t_s: bit if 10 <= t_s < 12 else 0))
    rows = messages(tmp_path, HEAD + data, "THIN")
    expected = [(0, 0), (10, bit), (12, bit), (72, 0)]  # a row has what stood since the one before
    assert [(row.TimeUS / 1e6, row.Flt) for row in rows] == expected
    log = ThinLog(lambda: UTC_S)
    log._allowance._level = 1.0  # of the first row: there are no more at once
    data = rows_of(log, outputs(pretend, range(61), faults=lambda t_s: bit if 10 <= t_s < 12 else 0))
    rows = messages(tmp_path, HEAD + data, "THIN")
    assert [(row.TimeUS, row.Flt) for row in rows] == [(0, 0), (60_000_000, bit)]


def test_texts_are_kept_and_a_flood_of_them_is_counted(tmp_path, pretend):
    def events(t_s):
        return tuple(Event(Severity.WARNING, f"{t_s}: text {number}") for number in range(3 if t_s else 40))

    log = ThinLog(lambda: UTC_S, (Event(Severity.INFO, "rambler 1"),))
    data = rows_of(log, outputs(pretend, range(62), events=events))
    texts = messages(tmp_path, HEAD + data, "MSG")
    assert texts[0].Message == "rambler 1"
    assert len(texts) == MAX_BURST_ROWS
    assert sum(row.Lost for row in messages(tmp_path, HEAD + data, "THNE")) == 1 + 40 + 60 * 3 - len(texts)
    later = rows_of(log, outputs(pretend, range(10_000, 10_001), events=events))
    assert len(messages(tmp_path, HEAD + later, "MSG")) == 3  # quiet for long: there is room again


def test_the_same_ticks_give_the_same_rows(pretend):
    first, second = (rows_of(ThinLog(lambda: UTC_S), outputs(pretend, range(200))) for _ in range(2))
    assert first == second


# ------------------------------------------------------------------------ the file


def row(text):
    return ardupilot.message_bytes(1.0, [Event(Severity.INFO, text)])


def written(directory, *texts, head=HEAD):
    """One start of the program after the other, each with a row."""
    for text in texts:
        file = ThinFile(directory, head)
        file.put(row(text))
        file.drain()
        file.close()


def content(directory):
    return {path.name: path.read_bytes() for path in log_files(directory / "thin").values()}


def test_the_next_start_goes_on_with_the_file(tmp_path):
    written(tmp_path, "one", "two")
    assert content(tmp_path) == {"00000001.BIN": HEAD + row("one") + row("two")}


@pytest.mark.parametrize("torn", [row("torn")[:-1], row("torn")[:40], row("torn")[:2], bytes(500)], ids=len)
def test_a_record_truncated_by_a_power_cut_is_removed(tmp_path, torn):
    written(tmp_path, "one")
    with (tmp_path / "thin/00000001.BIN").open("ab") as file:
        file.write(torn)
    written(tmp_path, "two")
    assert content(tmp_path) == {"00000001.BIN": HEAD + row("one") + row("two")}


def test_a_full_file_and_one_of_another_version_are_left(tmp_path, monkeypatch):
    monkeypatch.setattr(thin_file, "FILE_BYTES", len(HEAD) + len(row("one")))
    written(tmp_path, "one", "two")
    other = header((ardupilot.MSG,), 0)
    written(tmp_path, "three", head=other)
    assert content(tmp_path) == {
        "00000001.BIN": HEAD + row("one"),
        "00000002.BIN": HEAD + row("two"),
        "00000003.BIN": other + row("three"),
    }


@pytest.mark.parametrize("kind", KINDS)
def test_no_row_is_lost_to_a_disk_that_fails_for_a_while(tmp_path, kind, monkeypatch):
    number = 0
    while True:
        logs = tmp_path / f"{kind}{number}"
        (logs / "thin").mkdir(parents=True)
        file = ThinFile(logs, HEAD)
        rows = [row(text) for text in ("one", "two", "three")]
        with monkeypatch.context() as patches:
            disk = FaultyDisk(logs / "thin", patches)
            disk.arm(number, kind)
            for one in rows:
                file.put(one)
                file.drain()
            was_reached = bool(disk.failed)
            disk.arm(None)
            file.drain()
            assert file.failure == ""
            file.close()
        files = content(logs)
        assert b"".join(data.replace(HEAD, b"") for _, data in sorted(files.items())) == b"".join(rows)
        assert len(files) <= 2
        if not was_reached:
            break
        number += 1
    assert number > 5


def test_rows_are_queued_while_the_disk_is_missing(tmp_path):
    (tmp_path / "logs").write_text("in the way")
    file = ThinFile(tmp_path / "logs", b"head")
    for number in range(thin_file.MAX_QUEUED_TICKS + 3):
        file.put(b"%d," % number)
    file.drain()
    assert file.failure.startswith("thin log: ")
    assert file.lost == 3
    (tmp_path / "logs").unlink()
    file.drain()
    assert file.failure == ""
    ((_, data),) = content(tmp_path / "logs").items()
    assert data.count(b",") == thin_file.MAX_QUEUED_TICKS
    file.close()


def test_a_disk_that_stays_full_is_not_filled_with_empty_files(tmp_path, monkeypatch):
    file = ThinFile(tmp_path, b"head")
    file.put(b"row")

    def full(*_words):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patches:
        patches.setattr(os, "write", full)
        for _ in range(5):
            file.drain()
    assert content(tmp_path) == {}
    file.drain()
    assert content(tmp_path) == {"00000001.BIN": b"headrow"}
    file.close()
