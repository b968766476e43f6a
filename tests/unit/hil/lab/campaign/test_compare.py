import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hil.errors import UsageError
from hil.lab.campaign import compare, compare_page, page
from hil.lab.campaign.store import Results, read_results


def campaign(name, *, price, seeds=None, runs=60, never=()):
    """Return results whose error grows with the price of rudder travel."""
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
    found = compare.compare(campaign("a", price=1.0), campaign("b", price=2.0))
    assert found.pairs == 60
    by_name = {one.name: one for one in found.differences}
    assert by_name["rms_deg"].more.value == pytest.approx(0.1)
    assert by_name["rms_deg"].more.low == pytest.approx(0.1)  # each run by as much
    assert (by_name["rms_deg"].less, by_name["travel_deg_per_h"].less) == (0.0, 1.0)
    assert by_name["mean_deg"].more.value == 0.0
    assert found.failed_more.value > 0.0


def test_draws_of_only_one_campaign_do_not_prevent_pairs():
    first, second = campaign("a", price=1.0), campaign("b", price=2.0)
    second = replace(second, drawn={**second.drawn, "ship.T": np.ones(60)})
    assert compare.compare(first, second).pairs == 60


def test_campaigns_with_different_draws_are_independent_samples():
    first, second = campaign("a", price=1.0), campaign("b", price=2.0, seeds=np.arange(100, 160))
    found = compare.compare(first, second)
    assert found.pairs == 0
    by_name = {one.name: one for one in found.differences}
    assert by_name["rms_deg"].less is None
    assert by_name["rms_deg"].more.low < 0.0 < by_name["rms_deg"].more.value == pytest.approx(0.1)
    assert "independent samples" in compare_page.text(first, second, found)


def test_campaigns_of_different_length_share_the_rows_of_the_shorter():
    long, short = campaign("a", price=1.0), campaign("b", price=2.0)
    short = replace(
        short,
        seeds=short.seeds[:40],
        drawn={name: values[:40] for name, values in short.drawn.items()},
        scores={name: values[:40] for name, values in short.scores.items()},
        failed=short.failed[:40],
    )
    assert compare.compare(long, short).pairs == 40
    assert compare.compare(short, long).pairs == 40


def test_runs_that_never_settle_are_counted_and_rank_last():
    found = compare.compare(campaign("a", price=1.0, never=(1, 2)), campaign("b", price=1.0, never=(2, 3, 4)))
    settled = next(one for one in found.differences if one.name == "settling_s")
    assert (settled.never, settled.more.value, settled.values.size) == ((2, 3), 0.0, 60)
    assert np.count_nonzero(settled.values > 0.0) == 2
    assert settled.less == pytest.approx(1 / 60)


@pytest.mark.parametrize("seeds", [None, np.arange(100, 160)])
def test_an_infinite_median_is_shown_as_never_and_is_null_in_json(seeds):
    first = campaign("a", price=1.0)
    second = campaign("b", price=1.0, never=range(40), seeds=seeds)
    found = compare.compare(first, second)
    text = compare_page.text(first, second, found)
    assert "never" in next(row for row in compare_page.cells(found) if row[0].startswith("settling"))[2]
    assert "nan" not in text
    assert ">inf" not in text
    settled = json.loads(json.dumps(compare.as_json(found), allow_nan=False))["scores"]["settling_s"]
    assert (settled["of"], settled["first"], settled["second"]) == ("median", 50.0, None)


def test_the_detectable_difference_falls_with_the_number_of_runs():
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
    found = compare.compare(first, second)
    text = compare_page.text(first, second, found)
    assert "first: CTL_PRICE = 1.0" in text
    assert "sources: a, b" in text
    assert "nan" not in text
    assert json.loads(json.dumps(compare.as_json(found)))["scores"]["rms_deg"]["less_in"] == 0.0
    assert "nothing: the same specification" in compare_page.text(first, first, found)


def test_the_page_of_a_campaign_has_commands_that_repeat_the_worst_runs():
    results = campaign("a b", price=1.0, never=(17,))
    text = page.text(results, ["engine: a former name"])
    assert "engine: a former name" in text
    worst = int(np.argmax(results.scores["rms_deg"]))
    assert f"rambler-hil campaign replay &#x27;a b&#x27; {worst} --out &#x27;a b/run-{worst}&#x27;" in text
    assert "never in 1 runs" in text
    assert "swell &lt;b&gt;" in text
    assert "swell <b>" not in text
    assert "Sensitivity" in text


def test_the_page_of_a_campaign_without_scores():
    results = campaign("a", price=1.0)
    nothing = {name: np.full(60, np.nan) for name in results.scores}
    text = page.text(replace(results, scores=nothing, failed=np.array(["process ended"] * 60, object)))
    assert "60 failed: 100 %" in text
    assert "no run has this score" in text
    assert "nan" not in text


def test_results_of_an_unfinished_campaign_are_refused(tmp_path):
    (tmp_path / "campaign.json").write_text("{}")
    with pytest.raises(UsageError, match="is not finished; continue with --resume"):
        read_results(tmp_path)


def test_versions_that_differ_are_named():
    first, second = campaign("a", price=1.0), campaign("b", price=2.0)
    assert compare_page.versions_that_differ(first, first) == []
    assert compare_page.versions_that_differ(first, second) == ["sources: a, b"]
    named = replace(second, identity={**second.identity, "program": "rambler-hil 0.2"})
    assert compare_page.versions_that_differ(first, named) == ["program: unknown, rambler-hil 0.2", "sources: a, b"]
