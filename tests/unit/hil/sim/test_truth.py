"""truth.csv, written and read."""

import math

import numpy as np
import pytest

from hil.sim.truth import COLUMNS, TruthRecorder, read


def test_a_file_reads_back_and_an_absent_goal_is_an_empty_field(tmp_path):
    recorder = TruthRecorder()
    recorder.rows.append((0.0, 0.1, 0.2, -0.3, 0.4, 0.5, None, 6.0, 7.0, 0.4))
    recorder.rows.append((0.1, 12.3456789, 0.2, -0.3, 0.4, 0.5, math.pi, 6.0, 7.0, 0.4))
    path = tmp_path / "truth.csv"
    recorder.write(path)
    lines = path.read_text().splitlines()
    assert lines[0] == (
        "time_s,heading_low_rad,heading_rad,yaw_rate_rad_s,rudder_rad,rudder_command_rad,goal_rad,north_m,east_m,speed_m_s"
    )
    assert lines[1] == "0.0,0.1,0.2,-0.3,0.4,0.5,,6,7,0.4"
    for found in (read(path), recorder.table()):
        assert np.isnan(found.goal_rad[0])
        assert found.goal_rad[1] == pytest.approx(math.pi, abs=1e-8)
        assert found.heading_low_rad[1] == pytest.approx(12.3456789)


def test_an_empty_run_is_a_table_without_rows(tmp_path):
    recorder = TruthRecorder()
    recorder.write(tmp_path / "truth.csv")
    assert read(tmp_path / "truth.csv").time_s.size == 0
    assert len(COLUMNS) == 10


def test_another_file_is_refused(tmp_path):
    path = tmp_path / "other.csv"
    path.write_text("time_s,rudder_rad\n0,1\n")
    with pytest.raises(ValueError, match="not a truth"):
        read(path)
