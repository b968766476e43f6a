"""The command line of `rambler-hil bench`, with a measurement that takes no time."""

import json

import pytest

from hil.__main__ import main
from hil.bench import measurements
from hil.bench.figure import Figure, Finding


@pytest.fixture
def asked(monkeypatch, tmp_path):
    """Replace every measurement; the settings that they are given are noted."""
    found = []

    def row(name):
        def measure(setting):
            assert setting.directory.is_dir()
            assert setting.directory.parent == tmp_path
            found.append((name, setting))
            return Finding(name, (Figure(f"{name} figure", "ms", 1.0, 0.5),))

        return measurements.Measurement(name, measure)

    for name in measurements.TABLE:
        monkeypatch.setitem(measurements.TABLE, name, row(name))
    monkeypatch.chdir(tmp_path)
    return found


def test_everything_is_measured_in_one_run_and_nothing_is_left_behind(asked, capsys, tmp_path):
    assert main(["bench"]) == 0
    assert [name for name, _ in asked] == list(measurements.TABLE)
    assert len({id(setting) for _, setting in asked}) == 1
    assert "trips figure" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_one_measurement_can_be_chosen_and_the_quick_one_is_shorter(asked):
    assert main(["bench", "--only", "load", "--quick"]) == 0
    assert main(["bench", "--only", "load"]) == 0
    assert [name for name, _ in asked] == ["load", "load"]
    short, long = (setting for _, setting in asked)
    assert short.load_s < long.load_s
    assert long.load_s >= 30.0


def test_json_is_written(asked, tmp_path):
    assert main(["bench", "--only", "start", "--json", "found.json"]) == 0
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["findings"][0]["figures"][0]["ratio"] == 2.0
    assert found["circumstances"]["cores"] >= 1


def test_figures_go_over_those_of_the_documentation_and_others_stay(asked, tmp_path):
    (tmp_path / "figures.json").write_text('{"start_start_figure": {"value": 9.0}, "of_a_proof": {"value": 2.0}}')
    assert main(["bench", "--only", "start", "--quick", "--figures", "figures.json"]) == 0
    found = json.loads((tmp_path / "figures.json").read_text())
    assert found["of_a_proof"] == {"value": 2.0}
    fresh = found["start_start_figure"]
    assert (fresh["value"], fresh["unit"], fresh["bare"], fresh["ratio"]) == (1.0, "ms", 0.5, 2.0)
    assert fresh["command"] == "rambler-hil bench --quick"
    assert all(fresh[name] for name in ("when", "commit", "machine"))


@pytest.mark.parametrize(
    "words",
    [
        ["--only", "nothing"],
        ["--figures", "no/such/place.json"],
        ["--json", "no/such/place.json"],
        ["--json", "."],
        ["--dir", "no/such/place"],
        ["--nonsense"],
    ],
)
def test_bad_usage_is_one_line_and_measures_nothing(asked, capsys, words):
    assert main(["bench", *words]) == 2
    said = capsys.readouterr()
    assert len(said.err.splitlines()) == 1
    assert asked == []
