"""Specifications of campaigns: accepted forms and errors."""

import pytest

from hil.errors import UsageError
from hil.lab.campaign import campaign
from hil.lab.campaign.spec import SpecError
from support.campaign import COMPILED, read
from support.paths import ROOT

FAULT = {"what": ["none", "compass silent"], "at_s": {"uniform": [100, 200]}}


def test_drawn_names_are_those_with_several_values():
    spec = read()
    assert spec.drawn_names == ("scenario", "set.CTL_PRICE", "ship.K", "ship.speed", "with.receiver.lost")
    assert (spec.runs, spec.seed, spec.seconds, spec.options) == (8, 5, 400, ("receiver", "compass"))


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"engine": "unknown"}, "engine: 'unknown'; give 'firmware' or 'compiled'"),
        ({"runs": 0}, "runs: 0 is not allowed"),
        ({"runs": "400"}, "runs: '400' is not allowed"),
        ({"runs": True}, "runs: True is not allowed"),
        ({"runs": 2.5}, "runs: 2.5 is not allowed"),
        ({"runs": None}, "runs: is missing"),
        ({"seconds": float("nan")}, "seconds: nan is not allowed"),
        ({"seed": -1}, "seed: -1 is not allowed"),
        ({"scenarios": None}, "scenarios: list is empty"),
        ({"scenarios": "swel"}, "scenarios: unknown scenario 'swel'"),
        ({"scenarios": "swell+fish"}, "scenarios: unknown option 'fish'"),
        ({"goals": "0:0,400:9"}, "goals: a goal of '0:0,400:9' is later than the end at 400 s"),
        ({"goals": "x"}, "goals: goal 'x'"),
        ({"compass": ["nmea", "pni"]}, "compass: not supported by the compiled loop"),
        ({"compass": "oracle"}, "compass: 'oracle' is unknown"),
        ({"ship": {"Q": 1}}, "ship.Q: unknown key"),
        ({"ship": {"K": 11}}, "ship.K: 11.0 is not a number from 0.1 to 10"),
        ({"ship": 3}, "ship: must be a table, [ship]"),
        ({"with": {"unknown": 1}}, "with.unknown: unknown option"),
        ({"with": {"kt": True}}, "with.kt: ability has no default"),
        ({"with": {"leeway": {"body_deg": 3, "unknown": 1}}}, "with.leeway.unknown: unknown key"),
        ({"with": {"leeway": {"uniform": [0, 90]}}}, "with.leeway.body_deg: 90.0 is not a number from -45 to 45"),
        ({"with": {"supply": True}}, "with.supply: not supported by the compiled loop"),
        ({"set": {"FOO": 1}}, "set.FOO: unknown parameter 'FOO'"),
        ({"set": {"CTL_PRICE": -1}}, "set.CTL_PRICE: CTL_PRICE: -1 is out of range"),
        ({"set": {"CTL_PRICE": "x"}}, "set.CTL_PRICE: 'x' is not a number"),
        ({"set": {"FS_GCS_S": 10}}, "set.FS_GCS_S: not supported by the compiled loop"),
        ({"fault": FAULT}, "fault: not supported by the compiled loop"),
        ({"fault": {"what": "unknown", "at_s": 0}}, "fault.what: 'unknown' is unknown"),
        ({"fault": {"what": "killed"}}, "fault.at_s: is missing"),
        ({"fail": {"rms_deg": "a"}}, "fail.rms_deg: a is not a limit"),
        ({"fail": {"unknown": 1}}, "fail.unknown: unknown key"),
        ({"vehicle": "none.toml"}, "vehicle: vehicle file none.toml"),
        ({"unknown": 1}, "unknown: unknown key"),
    ],
)
def test_invalid_specification_is_refused(changes, problem):
    with pytest.raises(SpecError) as refusal:
        read(**changes)
    assert any(line.startswith(problem) for line in refusal.value.problems), refusal.value.problems
    assert all("\n" not in line for line in refusal.value.problems)


def test_all_errors_are_reported_at_once():
    with pytest.raises(SpecError) as refusal:
        read(runs=0, scenarios="swel", ship={"K": 11}, set={"FS_GCS_S": 10})
    assert len(refusal.value.problems) == 4


def test_faults_exclude_some_options_and_devices():
    assert read(engine="firmware", fault=FAULT, **{"with": None}).draws["fault.for_s"].quantile(0.0) == 30.0
    with pytest.raises(SpecError) as refusal:
        read(engine="firmware", fault=FAULT, compass="pni")
    assert [line.split(":")[0] for line in refusal.value.problems] == ["with.receiver", "compass"]


def test_digest_is_independent_of_the_order_of_keys():
    assert read().digest == read(dict(reversed(COMPILED.items()))).digest
    assert read().digest != read(seed=6).digest


def test_former_name_of_the_compiled_engine_is_accepted_with_a_note():
    assert read().notes == ()
    former = read(engine="twin")
    assert former.engine == "compiled"
    assert former.notes == ('engine: "twin" is the old name of "compiled"; both select the same engine',)


def test_each_error_line_names_the_file(tmp_path):
    path = tmp_path / "spec.toml"
    path.write_text('engine = "compiled"\nruns = 0\nseconds = 100\nscenarios = "swel"\n')
    with pytest.raises(UsageError) as refusal:
        campaign.read_spec(path)
    assert [line.split(": ")[:2] for line in str(refusal.value).splitlines()] == [
        [str(path), "scenarios"],
        [str(path), "runs"],
    ]


def test_option_that_contradicts_the_scenario_is_refused(tmp_path):
    path = tmp_path / "spec.toml"
    path.write_text(
        'engine = "compiled"\nruns = 1\nseconds = 100\nscenarios = ["swell", "calm"]\n[with]\norbital = 0.4\n'
    )
    with pytest.raises(UsageError, match="calm has no waves"):
        campaign.read_spec(path)


def test_examples_are_valid():
    examples = sorted((ROOT / "params").glob("campaign_*.toml"))
    assert [path.name for path in examples] == ["campaign_faults.toml", "campaign_twin.toml"]
    for path in examples:
        assert campaign.read_spec(path).drawn_names
