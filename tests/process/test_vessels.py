"""A ship that crosses, from the air to the log: the harness's run with the real program."""

import json

from support.harness import rambler_hil, replays

WORDS = ("run", "tank", "--speed", "max", "--seconds", "40", "--goal", "0:0", "--with", "vessels=crossing:0")


def test_a_crossing_ship_is_told_stepped_aside_for_and_replayed(tmp_path):
    settings = ("--set", "AIS_ACT=1", "--set", "AIS_NEAR_S=2400")
    code, _, errors = rambler_hil(*WORDS, *settings, "--out", str(tmp_path))
    assert (code, errors) == (0, "")
    said = (tmp_path / "firmware.log").read_text()
    assert " comes to " in said
    assert "A vessel comes near" in said
    assert "Steps aside to" in said
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["with"] == "vessels=crossing:0:40"
    (ship,) = summary["vessels"]
    assert ship["name"] == "CROSSING LADY"
    assert ship["closest_m"] > 10_000.0
    assert replays(tmp_path)
