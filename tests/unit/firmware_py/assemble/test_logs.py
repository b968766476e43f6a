"""Sizes of the log from the parameters, and the files of ground stations."""

from contextlib import ExitStack
from types import SimpleNamespace

import pytest

from firmware_py.assemble import logs
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.sensors.receiver_time import TimeCorrectedPosition

SIZES = {"LOG_FILE_MB": 3, "LOG_KEEP_MB": 500, "LOG_FREE_MB": 70, "LOG_KEEP_DAYS": 9}


@pytest.fixture
def parameters():
    values = ParameterSet()
    for name, value in SIZES.items():
        values = values.replaced(name, value)
    return values


def test_parameters_are_sizes_in_megabytes(parameters, tmp_path, monkeypatch):
    arguments, closed = {}, []

    def record(name, **more):
        arguments[name] = more
        return SimpleNamespace(close=lambda: closed.append(name))

    monkeypatch.setattr(logs, "LogRecorder", lambda directory, **more: record(directory.name, **more))
    monkeypatch.setattr(logs, "LocalDisk", lambda **more: more)
    clock = SimpleNamespace(utc_s=lambda: 1.7e9)
    with ExitStack() as opened:
        logs.log_recorder(tmp_path, parameters, Plans(), clock, "0123abcd", opened)
    (values,) = arguments.values()
    names = ("file_bytes", "max_total_bytes", "min_free_bytes", "utc_s", "wait_for_disk", "disk")
    disk = {"retention_days": 9, "reserve_bytes": 73_000_000}
    assert [values[name] for name in names] == [3_000_000, 500_000_000, 70_000_000, 1.7e9, False, disk]
    assert closed == list(arguments) == ["logs"]
    off = parameters.replaced("LOG_ENABLE", 0)
    assert logs.log_recorder(tmp_path, off, Plans(), clock, "", ExitStack()) is None


@pytest.mark.parametrize("enabled", [0, 1])
def test_ground_stations_get_the_logs_of_an_existing_directory(parameters, tmp_path, enabled):
    root = logs.file_root(tmp_path, parameters.replaced("LOG_ENABLE", enabled))
    assert (root.logging, root.background, root.catalogue()) == (bool(enabled), True, {})
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "00000007.BIN").touch()
    assert dict(root.catalogue()) == {7: tmp_path / "logs" / "00000007.BIN"}


def test_times_of_a_receiver_are_corrected(tmp_path):
    clock, receiver = SimpleNamespace(utc_s=lambda: 1.7e9), SimpleNamespace()
    assert logs.with_corrected_times(None, clock, tmp_path, print) is None
    assert isinstance(logs.with_corrected_times(receiver, clock, tmp_path, print), TimeCorrectedPosition)
