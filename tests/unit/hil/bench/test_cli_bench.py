"""The command line of `rambler-hil bench`, with simulated measurements."""

import json

import pytest

from hil.__main__ import main
from hil.bench import measurements
from hil.bench.figure import Figure, Finding
from hil.bench.machine import circumstances, text_of
from hil.report.figure_file import COUNTED


@pytest.fixture
def values():
    """Values of the next measurements; 1.0 after them."""
    return []


@pytest.fixture
def calls(monkeypatch, tmp_path, values):
    """Replace every measurement; return the names and settings of the calls."""
    calls = []

    def measurement(name):
        def measure(setting):
            assert setting.directory.is_dir()
            assert setting.directory.parent.parent == tmp_path
            assert not list(setting.directory.iterdir())
            (setting.directory / "left").touch()
            calls.append((name, setting))
            unit, value = COUNTED if name == "work" else "ms", values.pop(0) if values else 1.0
            return Finding(name, (Figure(f"{name} figure", unit, value, 0.5),))

        return measurements.Measurement(name, measure)

    for name in measurements.TABLE:
        monkeypatch.setitem(measurements.TABLE, name, measurement(name))
    monkeypatch.chdir(tmp_path)
    return calls


def test_all_measurements_leave_no_files(calls, capsys, tmp_path):
    assert main(["bench"]) == 0
    assert [name for name, _ in calls] == list(measurements.TABLE)
    assert "transfers figure" in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_only_selects_and_quick_shortens(calls):
    assert main(["bench", "--only", "load", "--quick"]) == 0
    assert main(["bench", "--only", "load"]) == 0
    assert [name for name, _ in calls] == ["load", "load"]
    short, long = (setting for _, setting in calls)
    assert short.load_s < long.load_s
    assert long.load_s >= 30.0


def test_repeats_are_measured_in_rounds(calls, values, tmp_path):
    values += [1.0, 2.0, 3.0, 9.0, 2.0, 7.0]
    words = ["bench", "--only", "load", "--only", "start", "--repeat", "3", "--quick", "--figures", "figures.json"]
    assert main(words) == 0
    assert [name for name, _ in calls] == ["load", "start"] * 3
    figures = json.loads((tmp_path / "figures.json").read_text())
    load, start = figures["load_load_figure"], figures["start_start_figure"]
    assert (load["value"], load["repeats"]) == (2.0, [2.0, 6.0, 4.0])
    assert (start["value"], start["repeats"]) == (7.0, [4.0, 18.0, 14.0])
    assert load["command"] == "rambler-hil bench --quick --repeat 3"


@pytest.fixture
def machine():
    return text_of(circumstances())


@pytest.fixture
def baseline(tmp_path, machine):
    """Return the path of a figure file in which only the load was repeated."""
    path = tmp_path / "baseline.json"
    load = {"value": 1.0, "machine": machine, "repeats": [2.0, 2.1, 1.9, 2.05, 1.95, 2.0, 2.0]}
    path.write_text(json.dumps({"load_load_figure": load, "start_start_figure": {"value": 1.0}}))
    return str(path)


def test_against_measures_only_the_baseline(calls, baseline, capsys):
    assert main(["bench", "--against", baseline]) == 0
    assert [name for name, _ in calls] == ["load"]
    assert "load figure: 2.00x before, 2.00x now" in capsys.readouterr().out


@pytest.mark.parametrize(("results", "code", "count"), [([5.0, 4.0, 3.0], 1, 3), ([5.0, 5.0, 1.0], 0, 2)])
def test_three_worse_results_in_a_row_exit_with_1(calls, values, baseline, capsys, results, code, count):
    values += results
    assert main(["bench", "--against", baseline]) == code
    assert capsys.readouterr().out.count("WORSE") == count
    assert len(calls) == 3


@pytest.mark.parametrize("machine", ["a board, 4 cores, Linux 6.1, Python 3.13.1, load 0.10 before the start"])
def test_baseline_of_another_machine_gives_no_verdict(calls, values, baseline, capsys):
    values += [5.0]
    assert main(["bench", "--against", baseline]) == 0
    output = capsys.readouterr().out
    assert "WORSE" in output
    assert "no verdict: baseline of another machine (a board, 4 cores" in output
    assert len(calls) == 1


@pytest.mark.parametrize(
    ("series", "code", "output"), [("", 1, "no verdict except counts: baseline"), ("9", 0, "no verdict: baseline")]
)
def test_counts_of_another_machine_with_the_same_python_are_compared(
    calls, values, tmp_path, series, code, output, capsys
):
    python = f"{circumstances()['python'].rpartition('.')[0]}{series}.99"
    machine = f"a board, 4 cores, Linux 6.1, Python {python}, load 0.10 before the start"
    path = tmp_path / "baseline.json"
    path.write_text(json.dumps({"work_work_figure": {"value": 1.0, "machine": machine, "repeats": [2.0] * 7}}))
    values += [1.15] * 3
    assert main(["bench", "--against", str(path)]) == code
    assert output in capsys.readouterr().out
    assert len(calls) == (3 if code else 1)


def test_json_file_contains_findings_and_circumstances(calls, tmp_path):
    assert main(["bench", "--only", "start", "--json", "results.json"]) == 0
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["findings"][0]["figures"][0]["ratio"] == 2.0
    assert results["circumstances"]["cores"] >= 1


def test_figures_are_merged(calls, tmp_path):
    (tmp_path / "figures.json").write_text('{"start_start_figure": {"value": 9.0}, "of_a_proof": {"value": 2.0}}')
    assert main(["bench", "--only", "start", "--quick", "--figures", "figures.json"]) == 0
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["of_a_proof"] == {"value": 2.0}
    start = figures["start_start_figure"]
    assert (start["value"], start["unit"], start["bare"], start["ratio"]) == (1.0, "ms", 0.5, 2.0)
    assert start["command"] == "rambler-hil bench --quick"
    assert all(start[name] for name in ("when", "commit", "machine"))


@pytest.mark.parametrize(
    "words",
    ["--only unknown", "--figures missing/file.json", "--json missing/file.json", "--json .", "--dir missing",
     "--against missing/file.json", "--repeat 0", "--unknown"],
)  # fmt: skip
def test_invalid_usage_gives_an_error_of_one_line(calls, capsys, words):
    assert main(["bench", *words.split()]) == 2
    output = capsys.readouterr()
    assert len(output.err.splitlines()) == 1
    assert calls == []
