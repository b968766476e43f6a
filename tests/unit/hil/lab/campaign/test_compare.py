"""Comparison of two campaigns, and the pages of a comparison and of a campaign."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hil.errors import UsageError
from hil.lab.campaign import compare, page
from hil.lab.campaign.store import Results, read_results


def campaign(name, *, price, seeds=None, runs=60, never=()):
    """Return results in which the error increases with the travel weight CTL_PRICE."""
    random = np.random.default_rng(7)
    ability, noise = random.uniform(0.7, 1.4, runs), random.normal(0.0, 0.2, runs)
    rms = 2.0 + ability + noise + 0.1 * price
    settling = np.full(runs, 50.0)
    settling[list(never)] = math.inf
    scores = {
        "rms_deg": rms,
        "mean_deg": noise,
        "worst_deg": 3.0 * rms,
        "travel_deg_per_h": 1500.0 / price + 100.0 * noise,
        "overshoot_deg": rms,
        "settling_s": settling,
    }
    return Results(
        Path(name),
        f"[set]\nCTL_PRICE = {price}",
        {"versions": {"numpy": "2", "sources": name}},
        np.arange(runs) if seeds is None else seeds,
        {"scenario": np.array(["sea", "swell <b>"] * (runs // 2), object), "ship.K": ability},
        scores,
        np.array([None] * runs, object),
        np.array(["rms_deg" if value > 3.4 else "" for value in rms], object),
    )


def test_runs_with_equal_draws_are_compared_in_pairs():
    comparison = compare.compare(campaign("a", price=1.0), campaign("b", price=2.0))
    assert comparison.pairs == 60
    by_name = {one.name: one for one in comparison.differences}
    assert by_name["rms_deg"].change.value == pytest.approx(0.1)
    assert by_name["rms_deg"].change.low == pytest.approx(0.1)  # all pairs have the same difference
    assert (by_name["rms_deg"].lower_fraction, by_name["travel_deg_per_h"].lower_fraction) == (0.0, 1.0)
    assert by_name["mean_deg"].change.value == 0.0
    assert comparison.failed_difference.value > 0.0


def test_draws_of_only_one_campaign_are_ignored_for_pairs():
    first, second = campaign("a", price=1.0), campaign("b", price=2.0)
    second = replace(second, drawn_values={**second.drawn_values, "ship.T": np.ones(60)})
    assert compare.compare(first, second).pairs == 60


def test_campaigns_with_different_draws_are_independent_samples():
    first, second = campaign("a", price=1.0), campaign("b", price=2.0, seeds=np.arange(100, 160))
    comparison = compare.compare(first, second)
    assert comparison.pairs == 0
    by_name = {one.name: one for one in comparison.differences}
    assert by_name["rms_deg"].lower_fraction is None
    assert by_name["rms_deg"].change.low < 0.0 < by_name["rms_deg"].change.value == pytest.approx(0.1)
    assert "independent samples" in compare.page_text(first, second, comparison)


def test_pairs_of_campaigns_of_different_length_are_those_of_the_shorter():
    long, short = campaign("a", price=1.0), campaign("b", price=2.0)
    short = replace(
        short,
        seeds=short.seeds[:40],
        drawn_values={name: values[:40] for name, values in short.drawn_values.items()},
        scores={name: values[:40] for name, values in short.scores.items()},
        failed=short.failed[:40],
    )
    assert compare.compare(long, short).pairs == 40
    assert compare.compare(short, long).pairs == 40


def test_runs_that_never_settle_are_counted_and_have_the_largest_rank():
    comparison = compare.compare(campaign("a", price=1.0, never=(1, 2)), campaign("b", price=1.0, never=(2, 3, 4)))
    settling = next(one for one in comparison.differences if one.name == "settling_s")
    assert (settling.never_counts, settling.change.value, settling.pair_changes.size) == ((2, 3), 0.0, 60)
    assert np.count_nonzero(settling.pair_changes > 0.0) == 2
    assert settling.lower_fraction == pytest.approx(1 / 60)


@pytest.mark.parametrize("seeds", [None, np.arange(100, 160)])
def test_infinite_median_is_never_in_the_table_and_null_in_json(seeds):
    first = campaign("a", price=1.0)
    second = campaign("b", price=1.0, never=range(40), seeds=seeds)
    comparison = compare.compare(first, second)
    text = compare.page_text(first, second, comparison)
    assert "never" in next(row for row in compare.table_rows(comparison) if row[0].startswith("settling"))[2]
    assert "nan" not in text
    assert ">inf" not in text
    settling = json.loads(json.dumps(compare.as_json(comparison), allow_nan=False))["scores"]["settling_s"]
    assert (settling["of"], settling["first"], settling["second"]) == ("median", 50.0, None)


def test_detectable_difference_decreases_with_the_number_of_runs():
    by_name = {one.name: one for one in _differences(60)}
    more = {one.name: one for one in _differences(240)}
    assert more["rms_deg"].detectable == pytest.approx(0.5 * by_name["rms_deg"].detectable, rel=0.2)
    assert more["rms_deg"].runs_for_small == pytest.approx(by_name["rms_deg"].runs_for_small, rel=0.4)
    assert by_name["mean_deg"].detectable > 0.0
    assert by_name["mean_deg"].runs_for_small is None
    assert by_name["settling_s"].detectable is None


def _differences(runs):
    first = campaign("a", price=1.0, runs=runs)
    other = campaign("b", price=1.0, runs=runs)
    noise = np.random.default_rng(3).normal(0.0, 0.3, runs)
    second = replace(other, scores={**other.scores, "rms_deg": other.scores["rms_deg"] + noise, "mean_deg": noise})
    return compare.compare(first, second).differences


def test_too_few_runs_are_refused():
    few = campaign("a", price=1.0, runs=4)
    with pytest.raises(UsageError, match="too few runs"):
        compare.compare(few, few)


def test_page_and_json_of_a_comparison():
    first, second = campaign("a", price=1.0), campaign("b", price=2.0, never=(3,))
    comparison = compare.compare(first, second)
    text = compare.page_text(first, second, comparison)
    assert "first: CTL_PRICE = 1.0" in text
    assert "sources: a, b" in text
    assert "nan" not in text
    assert json.loads(json.dumps(compare.as_json(comparison)))["scores"]["rms_deg"]["less_in"] == 0.0
    assert "nothing: the same specification" in compare.page_text(first, first, comparison)


def test_page_of_a_campaign_has_replay_commands_for_the_worst_runs():
    results = campaign("a b", price=1.0, never=(17,))
    text = page.text(results, ["engine: a former name"])
    assert "engine: a former name" in text
    worst = int(np.argmax(results.scores["rms_deg"]))
    assert f"rambler-hil campaign replay &#x27;a b&#x27; {worst} --out &#x27;a b/run-{worst}&#x27;" in text
    assert "never in 1 runs" in text
    assert "swell &lt;b&gt;" in text
    assert "swell <b>" not in text
    assert "Sensitivity" in text


def test_page_of_a_campaign_without_scores_contains_no_nan():
    results = campaign("a", price=1.0)
    no_scores = {name: np.full(60, np.nan) for name in results.scores}
    text = page.text(replace(results, scores=no_scores, failed=np.array(["process ended"] * 60, object)))
    assert "60 failed: 100 %" in text
    assert "First 50 of 60" in text
    assert "no run has this score" in text
    assert "nan" not in text


def test_results_of_an_unfinished_campaign_are_refused(tmp_path):
    (tmp_path / "campaign.json").write_text("{}")
    with pytest.raises(UsageError, match="is not finished; continue with --resume"):
        read_results(tmp_path)


def test_different_versions_are_listed():
    first, second = campaign("a", price=1.0), campaign("b", price=2.0)
    assert compare.changed_versions(first, first) == []
    assert compare.changed_versions(first, second) == ["sources: a, b"]
    with_program = replace(second, identity={**second.identity, "program": "rambler-hil 0.2"})
    assert compare.changed_versions(first, with_program) == ["program: unknown, rambler-hil 0.2", "sources: a, b"]
