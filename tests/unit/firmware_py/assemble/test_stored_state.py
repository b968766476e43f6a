"""Start parameters after failed starts, and problems of the stored state."""

import pytest

from firmware_py.assemble.stored_state import read_state, report_key_problem, select_start_parameters
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.common.records import Stored
from firmware_py.link.signing import KeyRecord, to_text
from firmware_py.system.state_directory import SIGNING_FILE
from firmware_py.system.store import Store

STEERING = {
    "CTL_HOLD_S": 11, "CTL_K1": 41, "CTL_K2": 0.8, "CTL_PRICE": 2, "CTL_TRIM_DEG": 1, "EST_TAU_S": 2, "LOIT_RADIUS": 90,
    "NAV_LOOK_S": 61, "POS_JUMP_S": 121, "POS_TIMEOUT_S": 6, "WP_RADIUS": 21,
}  # fmt: skip
# Of the mounting of devices, and one that does not affect the steering.
OTHERS = {"RUD_REVERSE": 1, "CMP_OFFSET_DEG": 5, "CMP_DEV_A": 2, "LOG_KEEP_MB": 500}


def with_values(values):
    parameters = ParameterSet()
    for name, value in values.items():
        parameters = parameters.replaced(name, value)
    return parameters


@pytest.mark.parametrize(
    ("early", "name"),
    [
        (0, ""),
        (2, ""),
        (3, "vehicle file's"),
        (5, "vehicle file's"),
        (6, "built-in"),
        (8, "built-in"),
        (90, "built-in"),
    ],
)
def test_three_early_ends_change_the_steering_parameters(early, name):
    stored, vehicle = with_values(OTHERS | {"CTL_K1": 55}), with_values({"CTL_K1": 41, "RUD_REVERSE": 0})
    texts = []
    used = select_start_parameters(stored, vehicle, early, texts.append)
    assert used["CTL_K1"] == {"": 55, "vehicle file's": 41, "built-in": 40}[name]
    assert {row: used[row] for row in OTHERS} == OTHERS
    expected = [f"{early} starts failed: {name} steering parameters", "Stored but not used: CTL_K1 55"]
    assert texts == (expected if name else [])


def test_stage_without_a_change_is_left_out():
    stored = with_values({"CTL_K1": 55})
    assert select_start_parameters(stored, stored, 3, lambda _text: None)["CTL_K1"] == 40


@pytest.mark.parametrize(("count", "more"), [(10, ""), (11, ", and more")])
def test_ten_unused_values_are_reported(count, more):
    texts = []
    stored = with_values(dict(list(STEERING.items())[:count]))
    select_start_parameters(stored, ParameterSet(), 3, texts.append)
    assert (texts[1].count(","), texts[1].endswith(more)) == (9 + bool(more), True)


KEY = to_text(KeyRecord(bytes(32 * [7]), 10**13, {}))
DAMAGE = "signing.key.1 is damaged"


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize(
    ("stored", "texts"),
    [
        (Stored(None), []),
        (Stored(KEY), []),
        (Stored(KEY, DAMAGE), [f"{DAMAGE}: the other slot is used, perhaps an older version"]),
        (Stored(b"rubbish"), ["signing.key lost: "]),
    ],
)
def test_problem_with_the_signing_key_is_reported(tmp_path, stored, texts, late):
    reported = []
    report_key_problem(tmp_path, stored, reported.append, late=late)
    expected = ["Signing key loaded and active"] * (late and stored.content == KEY) + texts
    assert [text[: len(start)] for text, start in zip(reported, expected, strict=True)] == expected


def test_key_that_others_can_read_is_reported(tmp_path):
    store = Store(tmp_path / "state", private=(SIGNING_FILE,))
    store.save(SIGNING_FILE, KEY, both_slots=True)
    store.close()
    path = next(path for path in (tmp_path / "state").iterdir() if path.name.startswith(SIGNING_FILE))
    path.chmod(0o644)
    texts = []
    report_key_problem(tmp_path / "state", Stored(KEY), texts.append)
    assert texts == [f"{path.name} is readable by other users; set a new key if they may have read it"]


@pytest.mark.parametrize("has_problem", [False, True])
def test_problem_of_the_state_directory_is_reported_with_what_could_be_read(tmp_path, has_problem):
    if has_problem:
        (tmp_path / "state").touch()
    store = Store(tmp_path / "state", wait=True)
    texts = []
    try:
        _, plans = read_state(tmp_path / "state", store, texts.append)
    finally:
        store.close()
    assert plans == Plans()
    inventory = "Loaded from storage: 0 parameters, mission of 0 items, fence of 0 items, rally of 0 items"
    expected = [store.start_problem, inventory]
    assert texts == (expected if has_problem else [])
    assert bool(store.start_problem) is has_problem
