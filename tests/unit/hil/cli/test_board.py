import pytest

from hil.__main__ import main
from hil.sim.run_directory import locked_directory


@pytest.mark.usefixtures("without_picture")
def test_board_replaces_a_run_with_a_notice_and_keeps_other_state(tmp_path, capsys):
    (tmp_path / "run.json").write_text("{}")
    (tmp_path / "boat").mkdir()
    assert main(["board", str(tmp_path), "--seconds", "0.2"]) == 0
    assert "an earlier run is replaced" in capsys.readouterr().err
    assert (tmp_path / "boat").is_dir()
    assert (tmp_path / "report.html").exists()
    (tmp_path / "state").mkdir()
    assert main(["board", str(tmp_path), "--seconds", "0.2"]) == 2
    assert "state exists and is not of an earlier run" in capsys.readouterr().err
    assert (tmp_path / "state").is_dir()


def test_second_board_is_rejected(tmp_path, capsys):
    (tmp_path / "compass").symlink_to("/dev/null")
    with locked_directory(tmp_path):
        assert main(["board", str(tmp_path), "--seconds", "10"]) == 2
    assert "another run is under way in it; give another --out, or wait for its end" in capsys.readouterr().err
    assert (tmp_path / "compass").is_symlink()
