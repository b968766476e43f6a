"""Writing and reading of truth.csv."""

import contextlib
import math
import tracemalloc
from collections import deque
from pathlib import Path

import numpy as np
import pytest

from hil.errors import HilError
from hil.sim.truth import COLUMNS, FLOAT_COLUMN, ROWS_PER_PIECE, TruthFile, read

ROW = (0.1, 12.3456789, 0.2, -0.3, 0.4, 0.5, math.pi, 6.0, 7.0, 0.4)


@pytest.fixture
def truth(tmp_path):
    file = TruthFile(tmp_path / "truth.csv")
    yield file
    file.close()


def test_written_rows_are_read_with_an_empty_goal(truth, tmp_path):
    truth.append((0.0, 0.1, 0.2, -0.3, 0.4, 0.5, None, 6.0, 7.0, 0.4))
    truth.append(ROW)
    truth.close()
    path = tmp_path / "truth.csv"
    lines = path.read_text().splitlines()
    assert lines[0] == (
        "time_s,heading_low_rad,heading_rad,yaw_rate_rad_s,rudder_rad,rudder_command_rad,goal_rad,north_m,east_m,speed_m_s"
    )
    assert lines[1] == "0.0,0.1,0.2,-0.3,0.4,0.5,,6,7,0.4"
    assert (truth.rows, truth.end_s) == (2, 0.1)
    for table in (read(path), truth.table()):
        assert np.isnan(table.goal_rad[0])
        assert table.goal_rad[1] == pytest.approx(math.pi, abs=1e-8)
        assert table.heading_low_rad[1] == pytest.approx(12.3456789)


def test_empty_file_has_no_rows(truth, tmp_path):
    truth.close()
    assert read(tmp_path / "truth.csv").time_s.size == 0
    assert len(COLUMNS) == 10
    assert list(truth) == []


def test_pieces_can_be_read_repeatedly(truth):
    for number in range(2 * ROWS_PER_PIECE + 5):
        truth.append((number / 10, *ROW[1:]))
    truth.close()
    for _ in range(2):
        assert [piece.time_s.size for piece in truth] == [ROWS_PER_PIECE, ROWS_PER_PIECE, 5]
    assert np.array_equal(np.concatenate([piece.time_s for piece in truth]), np.arange(2 * ROWS_PER_PIECE + 5) / 10)


def test_memory_does_not_grow_with_the_run(truth):
    truth.append(ROW)
    tracemalloc.start()
    try:
        initial_bytes = tracemalloc.get_traced_memory()[0]
        for number in range(5000):
            truth.append((number / 10, *ROW[1:]))
        growth_bytes = tracemalloc.get_traced_memory()[0] - initial_bytes
    finally:
        tracemalloc.stop()
    assert growth_bytes < 20_000


def test_full_disk_raises_an_error():
    file = TruthFile(Path("/dev/full"))
    with pytest.raises(HilError, match=r"/dev/full cannot be written: No space left"):
        deque(map(file.append, [ROW] * 1000), maxlen=0)
    with contextlib.suppress(HilError):
        file.close()


def test_other_file_is_rejected(tmp_path):
    path = tmp_path / "other.csv"
    path.write_text("time_s,rudder_rad\n0,1\n")
    with pytest.raises(ValueError, match="not a truth"):
        read(path)


def test_additional_column_is_last_and_skipped(tmp_path):
    path = tmp_path / "truth.csv"
    truth = TruthFile(path, (FLOAT_COLUMN,))
    truth.append((0.0, 0.1, 0.2, -0.3, 0.4, 0.5, None, 6.0, 7.0, 0.4, 0.15))
    truth.close()
    assert path.read_text().splitlines() == [
        ",".join([*COLUMNS, "float_heading_low_rad"]),
        "0.0,0.1,0.2,-0.3,0.4,0.5,,6,7,0.4,0.15",
    ]
    for table in (read(path), truth.table(), *truth):
        assert table.heading_low_rad == pytest.approx([0.1])
        assert table.speed_m_s == pytest.approx([0.4])
