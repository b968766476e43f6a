import json
import math

import pytest

from hil.errors import HilError, UsageError
from hil.lab.campaign import store
from hil.lab.campaign.row import Outcome, Result, failure, rows
from hil.lab.campaign.scores import Scores
from hil.lab.campaign.store import Store, pending_batches
from support.campaign import read

VERSIONS = {"python": "3", "sources": "abc"}


def scores(rms_deg=1.0, settling_s=50.0):
    """Return scores."""
    return Scores(rms_deg, 0.5, 4.0, 700.0, 2.0, settling_s)


def results(spec, first, last):
    """Return results of the rows [first, last), one of which never settled, and one did not end."""
    outcomes = {
        1: Outcome("b", scores(settling_s=math.inf), ("Compass: no data", "Heading lost")),
        2: Outcome("c", None, (), "the autopilot ended early"),
    }
    return [Result(row, outcomes.get(row.index, Outcome("a", scores(row.index)))) for row in rows(spec, first, last)]


def kept(directory, spec=None, versions=None):
    """Return the store of a specification."""
    directory.mkdir(exist_ok=True)
    return Store(directory, spec or read(), versions or VERSIONS)


def stored(directory, batches):
    """Store batches in this order and return the bytes of the final file."""
    one = kept(directory)
    one.begin(resume=False)
    for first, last in batches:
        one.add(first, last, results(one.spec, first, last))
    one.finish()
    return (directory / store.RUNS).read_bytes()


def test_the_order_of_batches_does_not_change_the_result(tmp_path):
    whole = stored(tmp_path / "a", [(0, 8)])
    assert stored(tmp_path / "b", [(6, 8), (0, 1), (3, 6), (1, 3)]) == whole
    assert not (tmp_path / "b" / store.PARTS).exists()


def test_deleted_results_are_computed_again(tmp_path):
    whole = stored(tmp_path, [(0, 8)])
    (tmp_path / store.RUNS).unlink()
    assert store.result_files(tmp_path, 0) == []
    one = kept(tmp_path)
    one.begin(resume=True)
    assert one.finished() == []
    one.add(0, 8, results(one.spec, 0, 8))
    one.finish()
    assert (tmp_path / store.RUNS).read_bytes() == whole


def test_a_row_has_draws_and_outcome_of_its_run(tmp_path):
    stored(tmp_path / "a", [(0, 4), (4, 8)])
    found = store.read_table(tmp_path / "a" / store.RUNS).to_pylist()
    assert [row["row"] for row in found] == list(range(8))
    expected = next(rows(read(), 1, 2))
    assert {name: found[1][name] for name in expected.drawn} == dict(expected.drawn)
    assert (found[1]["seed"], found[1]["digest"]) == (expected.seed, "b")
    assert (found[1]["settling_s"], found[1]["faults"]) == (math.inf, "Compass: no data; Heading lost")
    assert (found[2]["rms_deg"], found[2]["ended"]) == (None, "the autopilot ended early")
    assert found[0]["faults"] is None
    assert [row["row"] for row in found if row["failed"]] == [2, 4, 5, 6, 7]


def test_pending_batches_lie_between_the_parts():
    assert list(pending_batches(10, [], 4)) == [(0, 4), (4, 8), (8, 10)]
    assert list(pending_batches(10, [(2, 4), (7, 10)], 2)) == [(0, 2), (4, 6), (6, 7)]
    assert list(pending_batches(10, [(0, 10)], 4)) == []


def test_an_incomplete_part_is_deleted(tmp_path):
    one = kept(tmp_path)
    one.begin(resume=False)
    one.add(2, 4, results(one.spec, 2, 4))
    (tmp_path / store.PARTS / "00000004-00000006.parquet.new").write_bytes(b"PAR1")
    assert one.finished() == [(2, 4)]
    assert [path.name for path in (tmp_path / store.PARTS).iterdir()] == ["00000002-00000004.parquet"]


@pytest.mark.parametrize(
    ("more", "versions", "resume", "text"),
    [
        ({"seed": 6}, VERSIONS, True, "another specification; give another --out"),
        (
            {},
            {**VERSIONS, "sources": "def"},
            True,
            r"by rambler-hil .* versions \(sources\), and this is rambler-hil .*; use those",
        ),
        ({"seed": 6}, {**VERSIONS, "sources": "def"}, True, r"with other versions \(sources\)"),
        ({}, VERSIONS, False, "continue with --resume"),
    ],
)
def test_a_directory_of_another_campaign_is_refused(tmp_path, more, versions, resume, text):
    kept(tmp_path).begin(resume=False)
    kept(tmp_path).begin(resume=True)
    with pytest.raises(UsageError, match=text):
        kept(tmp_path, read(**more), versions).begin(resume=resume)


def test_a_directory_with_other_files_is_refused(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(UsageError, match="holds no campaign"):
        kept(tmp_path).begin(resume=False)


def test_a_campaign_that_was_killed_at_its_start_starts_again(tmp_path):
    (tmp_path / store.PARTS).mkdir()
    (tmp_path / f"{store.CAMPAIGN}.new").write_text("{")
    kept(tmp_path).begin(resume=False)
    assert store.read_identity(tmp_path)["digest"] == read().digest


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff"])
def test_an_invalid_campaign_file_is_refused(tmp_path, content):
    (tmp_path / store.CAMPAIGN).write_bytes(content)
    with pytest.raises(UsageError, match="holds no campaign"):
        store.read_identity(tmp_path)


def test_a_damaged_part_is_named(tmp_path):
    one = kept(tmp_path)
    one.begin(resume=False)
    one.add(0, 8, results(one.spec, 0, 8))
    part = tmp_path / store.PARTS / "00000000-00000008.parquet"
    part.write_bytes(part.read_bytes()[:-30])
    with pytest.raises(HilError, match=r"00000000-00000008.parquet cannot be read: .* remove it"):
        one.finish()


@pytest.mark.parametrize(
    ("outcome", "text"),
    [
        (Outcome("a", scores(2.0)), ""),
        (Outcome("a", scores(2.5)), "rms_deg 2.5"),
        (Outcome("a", scores(float("nan"))), "rms_deg never"),
        (Outcome("a", scores(1.0, math.inf)), "settling_s never"),
        (Outcome("a", None), "no goal lasted"),
        (Outcome("a", scores(), ended="process ended"), "process ended"),
        (Outcome("a", Scores(1.0, 0.5, 4.0, 700.0, 2.0, 100.5)), "settling_s 100.5"),
    ],
)
def test_a_run_fails_by_its_limits_or_by_its_end(outcome, text):
    assert failure(outcome, {"rms_deg": 2.0, "settling_s": 100.0}) == text


def test_a_mean_fails_on_either_side():
    assert failure(Outcome("a", Scores(1.0, -3.0, 4.0, 700.0, 2.0, 50.0)), {"mean_deg": 2.0}) == "mean_deg -3"


def test_rows_of_two_versions_are_not_mixed(tmp_path):
    one = kept(tmp_path)
    one.begin(resume=False)
    one.add(0, 4, results(one.spec, 0, 4))
    known = store.read_identity(tmp_path)
    del known["program"]  # absent in former versions
    (tmp_path / store.CAMPAIGN).write_text(json.dumps(known))
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    with pytest.raises(UsageError, match=r"was begun with other versions \(sources\), and this is rambler-hil"):
        kept(tmp_path, versions={**VERSIONS, "sources": "def"}).begin(resume=True)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before
    kept(tmp_path).begin(resume=True)  # the program's name does not matter
