"""Parameters and plans stored by another version are used as far as possible."""

import json

import pytest

from firmware_py.common.parameters import format_file
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.common.plan import from_text as plan_from_text
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.system.state_directory import PARAMETER_FILE, PLAN_FILES, load_parameters, load_plans
from firmware_py.system.store import Store


def edit(text, change):
    data = json.loads(text)
    change(data)
    return json.dumps(data)


def open_store(directory, name, content):
    """Return a store that contains a file of an earlier run."""
    store = Store(directory)
    store.save(name, content)
    store.close()
    return Store(directory)


def test_parameters_of_another_version_stay_in_the_store(tmp_path):
    texts = []
    text = b"CTL_K1 41\nNEW_ONE 3.5\nCTL_HOLD_S 1e+09\nnot a parameter\nODD_ONE nan\n"
    store = open_store(tmp_path, PARAMETER_FILE, text)
    values, unusable_values = load_parameters(store, texts.append)
    assert values == {"CTL_K1": 41.0}
    assert unusable_values == {"NEW_ONE": 3.5, "CTL_HOLD_S": 1e9}
    assert ["kept for another version" in line for line in texts] == [True, True, False, False]
    store.close()
    store = open_store(tmp_path, PARAMETER_FILE, format_file(unusable_values | values).encode())
    assert load_parameters(store, texts.append) == (values, unusable_values)
    store.close()


MISSION = Plan.of(PlanKind.MISSION, (PlanItem(16, 3, params=(0.0, 5.0, 0.0, 0.0), x=350000000, y=1390000000),))


def test_unknown_field_of_a_plan_is_ignored_and_reported(tmp_path):
    def change(data):
        data["plan"]["author"] = "the office"
        data["tide_m"] = 1.0

    text = edit(plan_to_text(MISSION), change)
    assert plan_from_text(text)[0] == MISSION
    store, texts = open_store(tmp_path, PLAN_FILES[PlanKind.MISSION], text.encode()), []
    assert load_plans(store, texts.append).mission == MISSION
    store.close()
    assert texts == [
        "stored mission.plan: field 'tide_m' is not known here, ignored",
        "stored mission.plan: plan: field 'author' is not known here, ignored",
    ]


@pytest.mark.parametrize("name", ["kind", "identity", "items"])
def test_incomplete_plan_is_refused(name):
    with pytest.raises(ValueError, match="not a plan"):
        plan_from_text(edit(plan_to_text(MISSION), lambda data: data["plan"].pop(name)))


def test_plan_is_stored_in_the_format_of_earlier_versions():
    stored_text = (
        '{"version":1,"plan":{"kind":0,"identity":1002911340,'
        '"items":"AxAAAQAAAAAAAKBAAAAAAAAAAACAk9wUgLfZUgAAAAA="},"$":"_Stored"}'
    )
    assert plan_to_text(MISSION) == stored_text
    assert plan_from_text(stored_text) == (MISSION, ())
    assert plan_from_text(stored_text.replace('"version":1,', ""))[0] == MISSION
