"""Replay of a run of a campaign."""

import json

import pytest

from hil.errors import UsageError
from hil.lab.campaign import replay, store
from hil.lab.campaign.campaign import read_spec
from hil.lab.campaign.engines import versions
from hil.lab.campaign.row import Outcome, Result, rows
from hil.lab.campaign.store import Store

TEXT = 'engine = "firmware"\nruns = 4\nseconds = 10\nscenarios = "tank"\n[ship]\nK = {uniform = [0.8, 1.2]}\n'


@pytest.fixture
def campaign(tmp_path):
    """Return the directory of a campaign of four runs, the last two of which are finished."""
    (tmp_path / "spec.toml").write_text(TEXT)
    (tmp_path / "out").mkdir()
    spec = read_spec(tmp_path / "spec.toml")
    campaign_store = Store(tmp_path / "out", spec, versions(), tmp_path)
    campaign_store.begin(resume=False)
    campaign_store.add(2, 4, [Result(row, Outcome("of no run", None)) for row in rows(spec, 2, 4)])
    return tmp_path / "out"


def test_result_of_a_finished_run_is_read_from_an_unfinished_campaign(campaign):
    spec = replay.read_campaign_spec(campaign)
    assert replay.result_of(campaign, spec, 3)["row"] == 3
    for index in (1, 4, -1):
        with pytest.raises(UsageError):
            replay.result_of(campaign, spec, index)


@pytest.mark.usefixtures("without_picture")
def test_replay_with_different_results_is_reported(campaign, tmp_path):
    identity = store.read_identity(campaign)
    (campaign / store.CAMPAIGN).write_text(json.dumps({**identity, "versions": {**identity["versions"], "numpy": "0"}}))
    (line,) = replay.replay(campaign, 3, tmp_path / "run").differences
    assert "instead of of no run; the campaign was run by rambler-hil " in line


def test_replay_of_a_changed_specification_is_refused(campaign):
    (campaign / store.SPEC).write_text(TEXT.replace("0.8", "0.7"))
    with pytest.raises(UsageError, match=r"changed since the campaign$"):
        replay.read_campaign_spec(campaign)
    identity = store.read_identity(campaign)
    (campaign / store.CAMPAIGN).write_text(
        json.dumps({**identity, "versions": {**identity["versions"], "sources": "0"}})
    )
    with pytest.raises(UsageError, match=r"the campaign was run by .* with other versions .sources."):
        replay.read_campaign_spec(campaign)
