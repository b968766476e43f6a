"""The thin log: a row per minute and per event, up to a limited number."""

import math
import os
import struct

import msgspec
import pytest
from pymavlink.DFReader import DFReader_binary

from firmware_py.common.records import Event, FixType, PositionSample, RudderFeedback, Severity
from firmware_py.common.reports import Energy, Flow, Power, Water
from firmware_py.faults.table import Fault
from firmware_py.log import ardupilot, thin, thin_file
from firmware_py.log.dataflash import header
from firmware_py.log.disk import log_files
from firmware_py.log.message_rows import Row
from firmware_py.log.thin import HEAD, ThinLog
from firmware_py.log.thin_file import ThinFile
from support.faulty_disk import KINDS, FaultyDisk
from support.full_log import ESTIMATE

MAX_BURST_ROWS = 20.0

UTC_S = 1.8e9


def outputs(fake, times_s, **changes):
    """Yield ticks of the fake autopilot; `changes` are fields of the snapshot, constant or functions of time."""
    state = fake.State()
    for t_s in times_s:
        inputs = fake.make_inputs(2)
        inputs = msgspec.structs.replace(inputs, tick=msgspec.structs.replace(inputs.tick, t_s=t_s), devices=())
        state, output = fake.step(state, inputs)
        values = {name: value(t_s) if callable(value) else value for name, value in changes.items()}
        events = values.pop("events", ())
        snapshot = msgspec.structs.replace(output.snapshot, t_s=t_s, **{"faults": 0, **values})
        yield inputs, msgspec.structs.replace(output, snapshot=snapshot, events=events)


def log_ticks(log, ticks):
    return b"".join(log.update(inputs, output) for inputs, output in ticks)


def messages(tmp_path, data, kind):
    """Return the messages of a type that pymavlink reads."""
    path = tmp_path / "read.BIN"
    path.write_bytes(HEAD + data)
    reader = DFReader_binary(str(path))
    rows = []
    while (message := reader.recv_msg()) is not None:
        if message.get_type() == kind:
            rows.append(message)
    reader.close()
    return rows


def test_columns_without_a_unit_have_no_multiplier():
    columns = (thin._single_column("A", "-", "charge"), thin._single_column("B", "W", "load_w"))
    row = Row(1, "X", (*columns, thin._double_column("C", "r", "latitude_rad")), thin.Minute)
    assert (row.type.values, row.type.units, row.type.multipliers) == ("Qffd", "s-Wr", "F-00")
    minute = thin.Minute(1.0, 60.0, 0, armed=False, faults=0)
    assert row.pack(0.0, minute)[11:] == struct.pack("<ffd", *[math.nan] * 3)


def test_a_row_has_sums_and_means_of_its_minute(tmp_path, fake):
    ticks = outputs(
        fake,
        range(601),
        heading_error_rad=lambda t_s: -0.3 if t_s % 2 else 0.1,
        energy=lambda t_s: Energy(travel_rad=0.01 * t_s, energy_j=2.0 * t_s),
        skipped_total=lambda t_s: t_s // 30,
    )
    data = log_ticks(ThinLog(lambda: UTC_S), ticks)
    sailing, upkeep = (messages(tmp_path, data, kind) for kind in ("THIN", "THNE"))
    assert len(sailing) == len(upkeep) == 11  # the first tick and ten minutes
    for row, more in zip(sailing[1:], upkeep[1:], strict=True):
        assert (row.Utc, row.Sec, row.Arm, row.Flt, more.Skip) == (UTC_S, 60.0, 0, 0, 2)
        assert row.Err == pytest.approx(-0.1, abs=0.01)
        assert row.Rms == pytest.approx(math.sqrt(0.05), abs=0.01)
        assert (row.Trv, more.Enr) == (pytest.approx(0.6), pytest.approx(120.0))
        assert math.isnan(row.Lat)
        assert math.isnan(more.BatV)  # not measured


def test_a_row_has_the_last_values_of_its_minute(tmp_path, fake):
    ticks = outputs(
        fake, range(61), armed=True, heading_rad=1.0, estimate=ESTIMATE, heading_error_rad=None,
        position=PositionSample(1.0, FixType.FIX_3D, 0.5, -0.25, 3.0, 0.75), position_ok=lambda t_s: t_s > 0,
        water=Water(0.5, 0.1, 0.25, -0.125, 0.1), servo=RudderFeedback(1.0, 0.1, 31.0, 12.5),
        heading_ok=lambda t_s: t_s > 0,
    )  # fmt: skip
    data = log_ticks(ThinLog(lambda: UTC_S), ticks)
    first, last = messages(tmp_path, data, "THIN")
    names = ("Arm", "Lat", "Lng", "Sog", "Hdg", "Err", "Rms", "U", "WT", "WSd")
    values = [1, 0.5, -0.25, 0.75, 1.0, math.nan, math.nan, 0.5, 0.1, 0.1]
    assert [getattr(last, name) for name in names] == pytest.approx(values, nan_ok=True)
    assert [first.Lat, first.Lng, first.Sog, first.Hdg] == pytest.approx([math.nan] * 4, nan_ok=True)
    (_, last) = messages(tmp_path, data, "THNE")
    names = ("CN", "CE", "TSrv", "TCmp", "VSrv", "BatV", "BatA", "SoC", "Sun", "Load", "Skip", "Lost")
    values = [0.25, -0.125, 31.0, math.nan, 12.5, *[math.nan] * 5, 0, 0]
    assert [getattr(last, name) for name in names] == pytest.approx(values, nan_ok=True)


def test_a_row_has_the_mean_powers_of_its_measured_part(tmp_path, fake):
    def power(t_s):  # the solar panels are measured from 90 s on
        solar, used = Flow(20.0 * max(0.0, t_s - 90.0), max(0.0, t_s - 90.0)), Flow(5.0 * t_s, t_s)
        return Power(12.5, -1.0, 0.8, solar_w=99.0, solar=solar, load=used, charged=Flow(0.0, t_s), discharged=used)

    data = log_ticks(ThinLog(lambda: UTC_S), outputs(fake, range(181), power=power))
    rows = messages(tmp_path, data, "THNE")[1:]
    for row in rows:
        assert (row.Load, row.BatV * row.BatA, row.SoC) == pytest.approx((5.0, -5.0, 0.8))
    assert [row.Sun for row in rows] == pytest.approx([math.nan, 20.0, 20.0], nan_ok=True)


@pytest.mark.parametrize(
    ("event_budget", "rows"),
    [(MAX_BURST_ROWS, [(0, False), (10, True), (12, True), (72, False)]), (1.0, [(0, False), (60, True)])],
    ids=["within_the_budget", "beyond_the_budget"],
)
def test_a_fault_has_a_row_at_once_and_is_part_of_the_next_minute(tmp_path, fake, event_budget, rows):
    """Each row has the faults since the previous row."""
    bit = 1 << Fault.COMPASS_LOST
    log = ThinLog(lambda: UTC_S)
    log._event_budget._level = event_budget
    data = log_ticks(log, outputs(fake, range(80), faults=lambda t_s: bit if 10 <= t_s < 12 else 0))
    read = [(row.TimeUS / 1e6, row.Flt == bit) for row in messages(tmp_path, data, "THIN")]
    assert read[: len(rows)] == rows
    assert {row.Flt for row in messages(tmp_path, data, "THIN")} == {0, bit}


def test_texts_beyond_the_limit_are_counted(tmp_path, fake):
    def events(t_s):
        return tuple(Event(Severity.WARNING, f"{t_s}: text {number}") for number in range(3 if t_s else 40))

    log = ThinLog(lambda: UTC_S, (Event(Severity.INFO, "rambler 1"),))
    data = log_ticks(log, outputs(fake, range(230), events=events))
    texts = messages(tmp_path, data, "MSG")
    assert texts[0].Message == "rambler 1"
    assert len(texts) == 21  # 20 at once and one after 120 s
    assert sum(row.Lost for row in messages(tmp_path, data, "THNE")) == 1 + 40 + 180 * 3 - len(texts)
    later = log_ticks(log, outputs(fake, range(10_000, 10_001), events=events))
    assert len(messages(tmp_path, later, "MSG")) == 3  # after a pause, texts are logged again


def test_the_same_ticks_give_the_same_rows(fake):
    first, second = (log_ticks(ThinLog(lambda: UTC_S), outputs(fake, range(200))) for _ in range(2))
    assert first == second


# ------------------------------------------------------------------------ the file


def row(text):
    return ardupilot.encode_texts(1.0, [Event(Severity.INFO, text)])


def write_runs(directory, *texts, head=HEAD):
    """Write one row in each of several runs of the program."""
    for text in texts:
        file = ThinFile(directory, head)
        file.put(row(text))
        file.drain()
        file.close()


def content(directory):
    return {path.name: path.read_bytes() for path in log_files(directory / "thin").values()}


@pytest.mark.parametrize("tail", [b"", row("torn")[:-1], row("torn")[:40], row("torn")[:2], bytes(500)], ids=len)
def test_the_next_run_continues_the_file_without_a_truncated_record(tmp_path, tail):
    write_runs(tmp_path, "one")
    with (tmp_path / "thin/00000001.BIN").open("ab") as file:
        file.write(tail)
    write_runs(tmp_path, "two")
    assert content(tmp_path) == {"00000001.BIN": HEAD + row("one") + row("two")}


@pytest.mark.parametrize(("missing_rows", "names"), [(1, ["00000001.BIN"]), (0, ["00000001.BIN", "00000002.BIN"])])
def test_a_file_of_a_mebibyte_is_full_and_all_files_have_at_most_100_mb(tmp_path, monkeypatch, missing_rows, names):
    limits_bytes = []
    monkeypatch.setattr(
        thin_file.LocalDisk, "prune", lambda _self, _directory, limit_bytes: limits_bytes.append(limit_bytes)
    )
    write_runs(tmp_path, "one")
    full = math.ceil((1_048_576 - len(HEAD)) / len(row("x")))
    (tmp_path / "thin/00000001.BIN").write_bytes(HEAD + row("x") * (full - missing_rows))
    write_runs(tmp_path, "two")
    assert list(content(tmp_path)) == names
    assert set(limits_bytes) == {100_000_000 - 1_048_576}


def test_a_full_file_and_one_of_another_version_are_not_continued(tmp_path, monkeypatch):
    monkeypatch.setattr(thin_file, "MAX_FILE_BYTES", len(HEAD) + len(row("one")))
    write_runs(tmp_path, "one", "two")
    other = header((ardupilot.MSG,), 0)
    write_runs(tmp_path, "three", head=other)
    expected = [HEAD + row("one"), HEAD + row("two"), other + row("three")]
    assert content(tmp_path) == {f"{number:08d}.BIN": data for number, data in enumerate(expected, start=1)}


@pytest.mark.parametrize("kind", KINDS)
def test_no_row_is_lost_by_a_temporary_disk_error(tmp_path, kind, monkeypatch):
    number, was_reached = -1, True
    while was_reached:
        number += 1
        logs = tmp_path / f"{kind}{number}"
        (logs / "thin").mkdir(parents=True)
        file = ThinFile(logs, HEAD)
        rows = [row(text) for text in ("one", "two", "three")]
        with monkeypatch.context() as patches:
            disk = FaultyDisk(logs / "thin", patches)
            disk.arm(number, kind)
            for data in rows:
                file.put(data)
                file.drain()
            was_reached = bool(disk.failed)
            disk.arm(None)
            file.drain()
            assert file.failure == ""
            file.close()
        files = content(logs)
        assert b"".join(data.replace(HEAD, b"") for _, data in sorted(files.items())) == b"".join(rows)
        assert len(files) <= 2
    assert number > 5


def test_rows_are_queued_up_to_a_limit_while_the_disk_is_missing(tmp_path):
    (tmp_path / "logs").write_text("not a directory")
    file = ThinFile(tmp_path / "logs", b"head")
    for number in range(4096 + 3):
        file.put(b"%d," % number)
    file.drain()
    assert file.failure.startswith("thin log: ")
    assert file.lost == 3
    (tmp_path / "logs").unlink()
    file.drain()
    assert file.failure == ""
    ((_, data),) = content(tmp_path / "logs").items()
    assert data.count(b",") == 4096
    file.close()


def test_rows_are_written_in_any_number_of_pieces(tmp_path, monkeypatch):
    write, pieces = os.write, []

    def write_piece(descriptor, data):
        pieces.append(data)
        assert len(pieces) < 900, "the rows are written again"
        return write(descriptor, data[:9])

    with monkeypatch.context() as patches:
        patches.setattr(os, "write", write_piece)
        write_runs(tmp_path, "one", "two")
    assert content(tmp_path) == {"00000001.BIN": HEAD + row("one") + row("two")}


def test_a_full_disk_is_not_filled_with_empty_files(tmp_path, monkeypatch):
    def fail(*_arguments):
        raise OSError(28, "No space left on device")

    file = ThinFile(tmp_path, b"head")
    file.put(b"row")
    with monkeypatch.context() as patches:
        patches.setattr(os, "write", fail)
        for _ in range(5):
            file.drain()
    assert content(tmp_path) == {}
    file.drain()
    assert content(tmp_path) == {"00000001.BIN": b"headrow"}
    file.close()
