"""Stored parameters and plans: unusable lines, boot count, a directory mounted late, readers without a lock."""

import pytest

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans, to_text
from firmware_py.common.records import Stored
from firmware_py.plans.items import Command
from firmware_py.system.slots import SlotWriter
from firmware_py.system.state_directory import (
    StateDirectory,
    StateFiles,
    find_exposed_key_files,
    load_plans,
    read_parameters,
)


class FakeStore:
    """A store in memory; saves are recorded and not loaded back."""

    def __init__(self, **contents):
        self.contents = {name.replace("_", "."): content for name, content in contents.items()}
        self.saved, self.idle_saves, self.tried, self.mounts = {}, {}, [], []

    def load(self, name):
        return self.contents.get(name)

    def save(self, name, content):
        self.saved[name] = content

    def save_if_idle(self, name, content):
        self.idle_saves[name] = content

    def try_save(self, name, content, done):
        self.tried.append((name, content, done))

    def on_mount(self, names, call):
        self.mounts.append((names, call))


def plan(kind, count=1):
    commands = (Command.WAYPOINT, Command.EXCLUDED_CIRCLE, Command.RALLY_POINT)
    command = dict(zip(PlanKind, commands, strict=True))[kind]
    return Plan.of(kind, [PlanItem(command, 3, True, (9.0, 0.0, 0.0, 0.0), number + 1, 1) for number in range(count)])


@pytest.mark.parametrize(
    ("content", "values", "unusable", "are_kept"),
    [
        (None, {}, {}, []),
        (b"CTL_K1 3\n# comment\n\nCTL_K1 4\n", {"CTL_K1": 4.0}, {}, []),
        (b"FUTURE 1.5e+1\nCTL_K1 1e9\nCTL_K1 3\n", {"CTL_K1": 3.0}, {"FUTURE": 15.0}, [True, True]),
        (b"FUTURE 1e999\n", {}, {}, [False]),
        (b"ABCDEFGHIJKLMNOP 1\nABCDEFGHIJKLMNOPQ 2\n", {}, {"ABCDEFGHIJKLMNOP": 1.0}, [True, False]),
        (b"\xff 1\n", {}, {}, [False]),
    ],
)
def test_values_that_this_version_cannot_use_are_kept(content, values, unusable, are_kept):
    texts = []
    assert read_parameters(content, texts.append) == (values, unusable)
    assert [", kept for another version" in text for text in texts] == are_kept


def test_boot_count_is_stored_with_the_other_values():
    store = FakeStore(parameters_param=b"CTL_K1 3\nFUTURE 1\nSTAT_BOOTCNT 7\n")
    StateDirectory(store, lambda _text: None).count_start()
    assert sorted(store.saved["parameters.param"].decode().splitlines()) == ["CTL_K1 3", "FUTURE 1", "STAT_BOOTCNT 8"]
    store = FakeStore()
    directory = StateDirectory(store, pytest.fail)
    assert directory.apply_parameters(ParameterSet()) == ParameterSet()
    directory.count_start()
    assert directory.apply_parameters(ParameterSet()) == ParameterSet().replaced("STAT_BOOTCNT", 1.0)
    assert store.saved["parameters.param"].split() == [b"STAT_BOOTCNT", b"1"]
    assert directory.inventory(Plans().replaced(plan(PlanKind.FENCE, 2))) == (
        "1 parameters, mission of 0 items, fence of 2 items, rally of 0 items"
    )


@pytest.mark.parametrize(("is_stored", "saved"), [(True, None), (False, [b"CTL_K1 3", b"CTL_K2 4"])])
def test_parameters_that_could_not_be_cleared_are_saved_again(is_stored, saved):
    store = FakeStore(parameters_param=b"CTL_K1 3\n")
    directory = StateDirectory(store, pytest.fail)
    directory.clear_parameters()
    ((name, content, done),) = store.tried
    assert (name, content) == ("parameters.param", b"")
    directory.save_parameters({"CTL_K2": 4.0})
    assert store.saved.pop("parameters.param").splitlines() == [b"CTL_K2 4"]
    done(is_stored)
    assert store.saved == ({} if saved is None else {"parameters.param": b"\n".join(saved) + b"\n"})


def test_directory_that_is_mounted_late_keeps_its_content_except_for_values_set_since_the_start():
    mission, fence, rally = (plan(kind) for kind in PlanKind)
    store, texts, results = FakeStore(fence_plan=to_text(fence).encode(), rally_plan=to_text(rally).encode()), [], []
    directory = StateDirectory(store, texts.append)
    assert directory.plans() == Plans().replaced(fence).replaced(rally)
    directory.save_parameters({"CTL_K1": 3.0})
    for new, is_stored in ((mission, True), (plan(PlanKind.FENCE, 2), False)):
        directory.save_plan(new, results.append)
        store.tried[-1][2](is_stored)
    assert results == [True, False]
    ((names, merge),) = store.mounts
    contents = dict.fromkeys(names, Stored())
    contents["parameters.param"] = Stored(b"CTL_K1 9\nCTL_K2 4\nSTAT_BOOTCNT 41\n", "parameters.param.1 is damaged")
    contents |= {"rally.plan": Stored(b"other"), "mission.plan": Stored(b"other")}
    merge(contents)
    assert sorted(store.saved["parameters.param"].splitlines()) == [b"CTL_K1 3", b"CTL_K2 4", b"STAT_BOOTCNT 42"]
    # The replaced mission, and the fence that the directory does not have.
    assert store.idle_saves == {"mission.plan": to_text(mission).encode(), "fence.plan": to_text(fence).encode()}
    assert texts == [
        "State directory mounted: its content is used from the next start",
        "parameters.param.1 is damaged",
    ]


def test_stored_plan_that_is_not_valid_is_reported_and_left_out():
    invalid = {kind: Plan.of(kind, [PlanItem(Command.WAYPOINT, 1)]) for kind in PlanKind}
    texts, contents = [], {}
    for kind, name in zip(PlanKind, ("mission_plan", "fence_plan", "rally_plan"), strict=True):
        contents[name] = to_text(invalid[kind]).encode()
    contents["rally_plan"] = to_text(plan(PlanKind.MISSION)).encode()
    assert load_plans(FakeStore(**contents), texts.append) == Plans()
    assert texts == [
        "stored mission.plan ignored: item 1: NAV_WAYPOINT: frame 1 is not supported",
        "stored fence.plan ignored: item 0: NAV_WAYPOINT is not known in a fence plan",
        "stored rally.plan ignored: it is a mission",
    ]


def test_differences_of_a_stored_plan_are_reported():
    content = to_text(plan(PlanKind.MISSION)).replace('"plan"', '"tide":1,"plan"')
    texts = []
    assert load_plans(FakeStore(mission_plan=content.encode()), texts.append).mission == plan(PlanKind.MISSION)
    assert len(texts) == 1
    assert texts[0].startswith("stored mission.plan: ")


def test_state_is_read_without_its_lock(tmp_path):
    files = StateFiles(tmp_path / "none")
    assert [files.load(name) for name in ("signing.key", "a.param")] == [None, None]
    writer = SlotWriter(tmp_path, frozenset({"signing.key"}))
    for name in ("signing.key", "a.param"):
        writer.write(name, name.encode())
    writer.close()
    files = StateFiles(tmp_path)
    assert [files.load(name) for name in ("signing.key", "a.param")] == [b"signing.key", b"a.param"]
    assert find_exposed_key_files(tmp_path) == ()
    for mode in (0o640, 0o610, 0o604, 0o601):
        (tmp_path / "signing.key.0").chmod(mode)
        assert find_exposed_key_files(tmp_path) == ("signing.key.0",)
