"""The links of the paper's chain that need no search."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.__main__ import main
from hil.cli.reproduce import text
from hil.lab.identify.identify import identify
from hil.lab.identify.manoeuvre_file import read
from hil.lab.reproduce import rows as table
from hil.lab.reproduce.chain import Voyage
from hil.lab.reproduce.manoeuvre import circles, predicted, sail, zigzag
from hil.lab.reproduce.rows import Row, Verdict, all_match
from hil.report.figures import goal_figures
from hil.ship import scenarios
from hil.sim.run_directory import held
from hil.sim.truth import Truth

DEG = math.pi / 180.0
TANK = scenarios.named("tank")


def test_a_zigzag_turns_at_its_angle_to_either_side():
    sailed = sail(OCEAN_RAMBLER, TANK, zigzag(20.0 * DEG, 20.0 * DEG), 300.0, 1)
    assert sailed.time_s[:2].tolist() == [0.0, 0.1]
    assert np.max(np.abs(sailed.rudder_rad)) == pytest.approx(20.0 * DEG, abs=0.05 * DEG)
    assert 18.0 * DEG < np.max(sailed.heading_low_rad) < 26.0 * DEG
    assert -26.0 * DEG < np.min(sailed.heading_low_rad) < -18.0 * DEG
    assert np.std(sailed.heading_rad - sailed.heading_low_rad) == pytest.approx(1.5 * DEG, rel=0.25)


def test_circles_hold_one_angle_after_the_other():
    sailed = sail(OCEAN_RAMBLER, scenarios.named("calm"), circles((10.0 * DEG, -30.0 * DEG), 60.0), 120.0, 1)
    late = np.diff(sailed.heading_low_rad)[-100:] * 10.0
    assert np.degrees(late) == pytest.approx(-1.4541, abs=0.01)  # physics.md section 1


def test_the_true_model_predicts_the_hull():
    sailed = sail(OCEAN_RAMBLER, TANK, zigzag(20.0 * DEG, 20.0 * DEG), 300.0, 2)
    assert np.max(np.abs(predicted(OCEAN_RAMBLER, sailed) - sailed.heading_low_rad)) < 0.1 * DEG
    wrong = KtModel(0.06, 4.0, 17.0, 0.0, 0.4)
    assert np.max(np.abs(predicted(wrong, sailed) - sailed.heading_low_rad)) > 3.0 * DEG


def test_what_is_recorded_is_a_manoeuvre_file(tmp_path):
    sailed = sail(OCEAN_RAMBLER, TANK, zigzag(20.0 * DEG, 20.0 * DEG), 30.0, 2)
    sailed.write(tmp_path / "zigzag.csv")
    recorded = read(tmp_path / "zigzag.csv")
    assert recorded.heading_rad == pytest.approx(sailed.heading_rad, abs=1e-6)
    assert recorded.rudder_rad == pytest.approx(sailed.rudder_rad, abs=1e-6)
    assert recorded.yaw_rate_rad_s is None


def truth(error_deg: np.ndarray) -> Truth:
    time_s = np.arange(error_deg.size) * 0.1
    zero = np.zeros(error_deg.size)
    return Truth(time_s, error_deg * DEG, error_deg * DEG, zero, zero, zero, zero, zero, zero, zero + 0.4)


def test_the_largest_steady_error_leaves_the_turn_out():
    error_deg = np.where(np.arange(4000) < 1000, 50.0, -0.5)
    error_deg[3000] = 2.5
    sailed = truth(error_deg)
    voyage = Voyage("tank", "paper", sailed, goal_figures((sailed,)))
    assert voyage.largest_error_deg == pytest.approx(2.5)
    assert table._voyage_row(voyage).verdict is Verdict.MATCHES
    error_deg[3500] = -3.2
    voyage = Voyage("tank", "paper", truth(error_deg), goal_figures((truth(error_deg),)))
    assert table._voyage_row(voyage).verdict is Verdict.MISSES


def chain_with_errors(error_deg: np.ndarray) -> SimpleNamespace:
    return SimpleNamespace(prediction_error_deg=error_deg, effort=SimpleNamespace(held_out_s=600.0))


def test_a_prediction_is_judged_by_its_mean_and_its_spread():
    good = table._prediction_rows(chain_with_errors(np.array([-1.0, 1.0, 0.5])))
    assert [row.verdict for row in good] == [Verdict.MATCHES] * 2
    bad = table._prediction_rows(chain_with_errors(np.array([15.0, 12.0, 0.5])))
    assert [row.verdict for row in bad] == [Verdict.MISSES] * 2


def test_one_miss_is_a_finding_and_silence_is_none():
    quiet = (
        Row("a", "1", "1", Verdict.MATCHES),
        Row("b", "-", "2", Verdict.SILENT),
        Row("c", "1", "2", Verdict.DIFFERS),
    )
    assert all_match(quiet)
    assert not all_match((*quiet, Row("d", "1", "9", Verdict.MISSES)))


def test_the_rows_without_an_answer_say_why():
    silent = table._silence_rows(OCEAN_RAMBLER)
    radius = silent[0]
    assert radius.ours == "15.8 m"
    assert radius.verdict is Verdict.DIFFERS
    assert "not bent" in radius.note
    assert {row.verdict for row in silent[1:]} == {Verdict.SILENT}
    assert all(row.note for row in silent)
    assert "not printed" in text(silent)


def test_bad_usage_is_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["reproduce", "--out", str(tmp_path / "file" / "under")]) == 2
    assert "give another directory" in capsys.readouterr().err
    assert main(["reproduce", "--seed", "-1"]) == 2


def test_two_chains_never_share_a_directory(tmp_path, capsys):
    with held(tmp_path):
        assert main(["reproduce", "--quick", "--out", str(tmp_path)]) == 2
    assert "another run is under way in it" in capsys.readouterr().err


@pytest.mark.proof
def test_the_tank_s_manoeuvres_tell_the_paper_s_ship(tmp_path):
    """Twenty minutes rather than two hours: alpha is looser, and all three lie where the stated errors say."""
    angles = (30.0 * DEG, -30.0 * DEG, 10.0 * DEG, -10.0 * DEG)
    sail(OCEAN_RAMBLER, TANK, zigzag(20.0 * DEG, 20.0 * DEG), 600.0, 1).write(tmp_path / "zigzag.csv")
    sail(OCEAN_RAMBLER, TANK, circles(angles, 150.0), 600.0, 2).write(tmp_path / "circles.csv")
    recordings = [read(tmp_path / f"{name}.csv") for name in ("zigzag", "circles")]
    found = identify(recordings, model="cubic").judgement.estimates
    for name, true in (("K", 0.049), ("T", 4.0), ("alpha", 17.0)):
        assert abs(found[name].value - true) <= 3.0 * found[name].se
        assert found[name].verdict == "identifiable"
