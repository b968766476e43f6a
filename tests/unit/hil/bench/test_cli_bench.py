"""The command line of `rambler-hil bench`, with a measurement that takes no time."""

import json

import pytest

from hil.__main__ import main
from hil.bench import measurements
from hil.bench.figure import Figure, Finding
from hil.bench.machine import circumstances, text_of
from hil.report.figure_file import COUNTED


@pytest.fixture
def values():
    """What the next measurements find; 1.0 when there are no more."""
    return []


@pytest.fixture
def calls(monkeypatch, tmp_path, values):
    """Replace every measurement; the settings that they are given are noted."""
    found = []

    def row(name):
        def measure(setting):
            assert setting.directory.is_dir()
            assert setting.directory.parent.parent == tmp_path
            assert not list(setting.directory.iterdir())
            (setting.directory / "left").touch()
            found.append((name, setting))
            return Finding(
                name,
                (Figure(f"{name} figure", COUNTED if name == "work" else "ms", values.pop(0) if values else 1.0, 0.5),),
            )

        return measurements.Measurement(name, measure)

    for name in measurements.TABLE:
        monkeypatch.setitem(measurements.TABLE, name, row(name))
    monkeypatch.chdir(tmp_path)
    return found


def test_all_measurements_leave_no_files(calls, capsys, tmp_path):
    assert main(["bench"]) == 0
    assert [name for name, _ in calls] == list(measurements.TABLE)
    assert "transfers figure" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_only_and_quick(calls):
    assert main(["bench", "--only", "load", "--quick"]) == 0
    assert main(["bench", "--only", "load"]) == 0
    assert [name for name, _ in calls] == ["load", "load"]
    short, long = (setting for _, setting in calls)
    assert short.load_s < long.load_s
    assert long.load_s >= 30.0


def test_repeats_in_rounds(calls, values, tmp_path):
    values += [1.0, 2.0, 3.0, 9.0, 2.0, 7.0]
    words = ["bench", "--only", "load", "--only", "start", "--repeat", "3", "--quick", "--figures", "figures.json"]
    assert main(words) == 0
    assert [name for name, _ in calls] == ["load", "start"] * 3
    found = json.loads((tmp_path / "figures.json").read_text())
    assert (found["load_load_figure"]["value"], found["load_load_figure"]["repeats"]) == (2.0, [2.0, 6.0, 4.0])
    assert (found["start_start_figure"]["value"], found["start_start_figure"]["repeats"]) == (7.0, [4.0, 18.0, 14.0])
    assert found["load_load_figure"]["command"] == "rambler-hil bench --quick --repeat 3"


@pytest.fixture
def machine():
    return text_of(circumstances())


@pytest.fixture
def baseline(tmp_path, machine):
    """Return the path of figures of which that of the load was repeated."""
    path = tmp_path / "before.json"
    repeated = {"value": 1.0, "machine": machine, "repeats": [2.0, 2.1, 1.9, 2.05, 1.95, 2.0, 2.0]}
    path.write_text(json.dumps({"load_load_figure": repeated, "start_start_figure": {"value": 1.0}}))
    return str(path)


def test_against_measures_only_the_baseline(calls, baseline, capsys):
    assert main(["bench", "--against", baseline]) == 0
    assert [name for name, _ in calls] == ["load"]
    assert "load figure: 2.00x before, 2.00x now" in capsys.readouterr().out


def test_three_worse_results_in_a_row_exit_with_1(calls, values, baseline, capsys):
    values += [5.0, 4.0, 3.0]
    assert main(["bench", "--against", baseline]) == 1
    assert capsys.readouterr().out.count("WORSE") == len(calls) == 3


def test_a_temporary_load_is_not_worse(calls, values, baseline, capsys):
    values += [5.0, 5.0, 1.0]
    assert main(["bench", "--against", baseline]) == 0
    assert capsys.readouterr().out.count("WORSE") == 2
    assert len(calls) == 3


@pytest.mark.parametrize("machine", ["a board, 4 cores, Linux 6.1, Python 3.13.1, load 0.10 before the start"])
def test_no_verdict_on_another_machine(calls, values, baseline, capsys):
    values += [5.0]
    assert main(["bench", "--against", baseline]) == 0
    output = capsys.readouterr().out
    assert "WORSE" in output
    assert "no verdict: baseline of another machine (a board, 4 cores" in output
    assert len(calls) == 1


@pytest.mark.parametrize(
    ("series", "code", "output"), [("", 1, "no verdict except counts: baseline"), ("9", 0, "no verdict: baseline")]
)
def test_verdict_on_counts_with_the_same_python(calls, values, tmp_path, series, code, output, capsys):
    python = f"{circumstances()['python'].rpartition('.')[0]}{series}.99"
    machine = f"a board, 4 cores, Linux 6.1, Python {python}, load 0.10 before the start"
    path = tmp_path / "before.json"
    path.write_text(json.dumps({"work_work_figure": {"value": 1.0, "machine": machine, "repeats": [2.0] * 7}}))
    values += [1.15] * 3
    assert main(["bench", "--against", str(path)]) == code
    assert output in capsys.readouterr().out
    assert len(calls) == (3 if code else 1)


def test_json_file(calls, tmp_path):
    assert main(["bench", "--only", "start", "--json", "found.json"]) == 0
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["findings"][0]["figures"][0]["ratio"] == 2.0
    assert found["circumstances"]["cores"] >= 1


def test_figures_are_merged(calls, tmp_path):
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
        ["--against", "no/such/place.json"],
        ["--repeat", "0"],
        ["--nonsense"],
    ],
)
def test_bad_usage(calls, capsys, words):
    assert main(["bench", *words]) == 2
    output = capsys.readouterr()
    assert len(output.err.splitlines()) == 1
    assert calls == []
