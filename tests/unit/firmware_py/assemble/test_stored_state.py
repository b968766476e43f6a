"""Start parameters after failed starts."""

import pytest

from firmware_py.assemble.stored_state import select_start_parameters
from firmware_py.common.parameters import ParameterSet

STEERING = {
    "CTL_HOLD_S": 11, "CTL_K1": 41, "CTL_K2": 0.8, "CTL_PRICE": 2, "CTL_TRIM_DEG": 1, "EST_TAU_S": 2, "LOIT_RADIUS": 90,
    "NAV_LOOK_S": 61, "POS_JUMP_S": 121, "POS_TIMEOUT_S": 6, "WP_RADIUS": 21,
}  # fmt: skip
MOUNTING = {"RUD_REVERSE": 1, "CMP_OFFSET_DEG": 5, "CMP_DEV_A": 2, "LOG_KEEP_MB": 500}


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
    stored, vehicle = with_values(MOUNTING | {"CTL_K1": 55}), with_values({"CTL_K1": 41, "RUD_REVERSE": 0})
    texts = []
    used = select_start_parameters(stored, vehicle, early, texts.append)
    assert used["CTL_K1"] == {"": 55, "vehicle file's": 41, "built-in": 40}[name]
    assert {row: used[row] for row in MOUNTING} == MOUNTING
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
