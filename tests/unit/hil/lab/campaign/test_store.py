"""Directory of a campaign: batches, resumption, refusals, and the reasons for failed runs."""

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
    return Scores(rms_deg, 0.5, 4.0, 700.0, 2.0, settling_s)


def results(spec, first, last):
    """Return results of the rows [first, last); run 1 never settles and run 2 ends early."""
    outcomes = {
        1: Outcome("b", scores(settling_s=math.inf), ("Compass: no data", "Heading lost")),
        2: Outcome("c", None, (), "the autopilot ended early"),
    }
    return [Result(row, outcomes.get(row.index, Outcome("a", scores(row.index)))) for row in rows(spec, first, last)]


def new_store(directory, spec=None, versions=None):
    directory.mkdir(exist_ok=True)
    return Store(directory, spec or read(), versions or VERSIONS)


def store_batches(directory, batches):
    """Store batches in this order and return the content of the final file."""
    campaign = new_store(directory)
    campaign.begin(resume=False)
    for first, last in batches:
        campaign.add(first, last, results(campaign.spec, first, last))
    campaign.finish()
    return (directory / store.RUNS).read_bytes()


def test_result_is_independent_of_the_order_of_batches(tmp_path):
    expected_bytes = store_batches(tmp_path / "a", [(0, 8)])
    assert store_batches(tmp_path / "b", [(6, 8), (0, 1), (3, 6), (1, 3)]) == expected_bytes
    assert not (tmp_path / "b" / store.PARTS).exists()


def test_deleted_results_are_computed_again(tmp_path):
    expected_bytes = store_batches(tmp_path, [(0, 8)])
    (tmp_path / store.RUNS).unlink()
    assert store.result_files(tmp_path, 0) == []
    campaign = new_store(tmp_path)
    campaign.begin(resume=True)
    assert campaign.finished() == []
    campaign.add(0, 8, results(campaign.spec, 0, 8))
    campaign.finish()
    assert (tmp_path / store.RUNS).read_bytes() == expected_bytes


def test_row_contains_draws_and_outcome_of_its_run(tmp_path):
    store_batches(tmp_path / "a", [(0, 4), (4, 8)])
    table = store.read_table(tmp_path / "a" / store.RUNS).to_pylist()
    assert [row["row"] for row in table] == list(range(8))
    expected = next(rows(read(), 1, 2))
    assert {name: table[1][name] for name in expected.drawn_values} == dict(expected.drawn_values)
    assert (table[1]["seed"], table[1]["digest"]) == (expected.seed, "b")
    assert (table[1]["settling_s"], table[1]["faults"]) == (math.inf, "Compass: no data; Heading lost")
    assert (table[2]["rms_deg"], table[2]["ended"]) == (None, "the autopilot ended early")
    assert table[0]["faults"] is None
    assert [row["row"] for row in table if row["failed"]] == [2, 4, 5, 6, 7]


def test_pending_batches_are_the_gaps_between_finished_ranges():
    assert list(pending_batches(10, [], 4)) == [(0, 4), (4, 8), (8, 10)]
    assert list(pending_batches(10, [(2, 4), (7, 10)], 2)) == [(0, 2), (4, 6), (6, 7)]
    assert list(pending_batches(10, [(0, 10)], 4)) == []


def test_incomplete_batch_file_is_deleted(tmp_path):
    campaign = new_store(tmp_path)
    campaign.begin(resume=False)
    campaign.add(2, 4, results(campaign.spec, 2, 4))
    (tmp_path / store.PARTS / "00000004-00000006.parquet.new").write_bytes(b"PAR1")
    assert campaign.finished() == [(2, 4)]
    assert [path.name for path in (tmp_path / store.PARTS).iterdir()] == ["00000002-00000004.parquet"]


@pytest.mark.parametrize(
    ("changes", "versions", "resume", "error"),
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
def test_directory_of_another_campaign_is_refused(tmp_path, changes, versions, resume, error):
    new_store(tmp_path).begin(resume=False)
    new_store(tmp_path).begin(resume=True)
    with pytest.raises(UsageError, match=error):
        new_store(tmp_path, read(**changes), versions).begin(resume=resume)


def test_directory_with_other_files_is_refused(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(UsageError, match="contains no campaign"):
        new_store(tmp_path).begin(resume=False)


def test_campaign_killed_while_starting_starts_again(tmp_path):
    (tmp_path / store.PARTS).mkdir()
    (tmp_path / f"{store.CAMPAIGN}.new").write_text("{")
    new_store(tmp_path).begin(resume=False)
    assert store.read_identity(tmp_path)["digest"] == read().digest


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff"])
def test_invalid_campaign_file_is_refused(tmp_path, content):
    (tmp_path / store.CAMPAIGN).write_bytes(content)
    with pytest.raises(UsageError, match="contains no campaign"):
        store.read_identity(tmp_path)


def test_error_names_a_damaged_batch_file(tmp_path):
    campaign = new_store(tmp_path)
    campaign.begin(resume=False)
    campaign.add(0, 8, results(campaign.spec, 0, 8))
    part = tmp_path / store.PARTS / "00000000-00000008.parquet"
    part.write_bytes(part.read_bytes()[:-30])
    with pytest.raises(HilError, match=r"00000000-00000008.parquet cannot be read: .* remove it"):
        campaign.finish()


@pytest.mark.parametrize(
    ("outcome", "error"),
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
def test_run_fails_by_its_limits_or_an_early_end(outcome, error):
    assert failure(outcome, {"rms_deg": 2.0, "settling_s": 100.0}) == error


def test_limit_of_the_mean_applies_to_both_signs():
    assert failure(Outcome("a", Scores(1.0, -3.0, 4.0, 700.0, 2.0, 50.0)), {"mean_deg": 2.0}) == "mean_deg -3"


def test_resumption_with_other_versions_is_refused_and_changes_no_file(tmp_path):
    campaign = new_store(tmp_path)
    campaign.begin(resume=False)
    campaign.add(0, 4, results(campaign.spec, 0, 4))
    identity = store.read_identity(tmp_path)
    del identity["program"]  # absent in former versions
    (tmp_path / store.CAMPAIGN).write_text(json.dumps(identity))
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    with pytest.raises(UsageError, match=r"was begun with other versions \(sources\), and this is rambler-hil"):
        new_store(tmp_path, versions={**VERSIONS, "sources": "def"}).begin(resume=True)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before
    new_store(tmp_path).begin(resume=True)  # the program's name does not matter
