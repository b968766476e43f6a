import pytest

from hil.__main__ import main
from hil.sim.run_directory import held


@pytest.mark.parametrize("name", ["run.json", "campaign.json"])
def test_a_board_overwrites_the_truth_of_no_run(name, tmp_path, capsys):
    (tmp_path / name).write_text("{}")
    (tmp_path / "truth.csv").write_text("kept")
    assert main(["board", str(tmp_path), "--seconds", "10"]) == 2
    assert "whose results would be lost; give another" in capsys.readouterr().err
    assert (tmp_path / "truth.csv").read_text() == "kept"


def test_two_boards_never_share_their_ports(tmp_path, capsys):
    (tmp_path / "compass").symlink_to("/dev/null")
    with held(tmp_path):
        assert main(["board", str(tmp_path), "--seconds", "10"]) == 2
    assert "another run is under way in it; give another, or wait for its end" in capsys.readouterr().err
    assert (tmp_path / "compass").is_symlink()
