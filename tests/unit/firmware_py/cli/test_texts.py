"""Each text that a ground station can be told has an entry, and each entry a text."""

import re

import pytest

from firmware_py.cli.texts.faults import REMEDIES
from firmware_py.cli.texts.page import SECTIONS, markdown
from firmware_py.faults.fault import Fault
from firmware_py.faults.table import TABLE
from support.told_texts import told

ENTRIES = {text: row for section in SECTIONS.values() for text, row in section.items()}
PATTERNS = {
    text: re.compile("(?s)" + ".+".join(re.escape(part) for part in re.split("<[^<>]*>", text))) for text in ENTRIES
}
# What only hands on a text, and its texts where no maker that support.told_texts knows has made them.
HANDED_ON = {
    "assemble/earlier_runs.py: store.obstacle": (),  # StoreError
    "assemble/supervision.py: event.text": (),
    "assemble/supervision.py: note": (),  # WatchdogError
    "assemble/wiring.py: text": (),  # say
    "common/parameters.py: '\\n'.join(problems)": (),  # ParameterError
    "core/accept.py: str(error)": (),  # ParameterError
    "core/accept.py: problem.shown(first)": (),  # PlanProblem
    "core/step.py: after.greeting": (),
    "faults/latch.py: row.recovery": (),  # the table of faults
    "faults/latch.py: row.text": (),
    "guidance/traffic.py: f'AIS: {texts[-1]}'": ("AIS: another ship sends her number 235000007",),
    "link/commands/goals.py: goal": (),
    "link/commands/plan.py: home": (),
    "link/commands/server.py: f'{self.name}: {reason}'": (),  # denied
    "link/commands/server.py: text": (),  # Answer
    "link/commands/state.py: text": (),  # as the refusal of arming
    "link/commands/upkeep.py: now.text": (),  # Calibration
    "link/commands/upkeep.py: now.text or 'Compass calibration was broken off'": (),
    "link/commands/compass_swing.py: str(error)": (),  # ParameterError
    "link/commands/pending.py: f'{call.name}: {failure}'": (),  # once_stored
    "link/commands/pending.py: text": (),
    "link/companion.py: reported(message)": (),
    "link/context.py: answer.text or f'{name} refused'": (),
    "link/context.py: f'{name}: {intent}'": (),
    "link/context.py: text": (),
    "link/endpoint.py: event.text": (),
    "link/endpoint.py: text": (),  # tell
    "link/files/answers.py: refusal.text": (),
    "link/files/writing.py: f'{name}: {reason}'": (),  # PlanProblem, ParameterError
    "link/manual_control.py: intent": (),
    "link/manual_control.py: ManualRudder(deflection)": (),
    "link/mission/server.py: answer.text or f'Item {message.seq} was refused'": (),
    "link/mission/upload.py: answer.text or 'it was refused'": (),
    "link/parameters/server.py: text": (),
    "link/setpoints.py: goal": (),
    "link/setpoints.py: home": (),
    "link/setpoints.py: text": (),
    "link/telemetry/statustext.py: _ago(now_s - told_s) + event.text": (),
    "log/ardupilot.py: text": (),
    "sensors/pni_calibration.py: text": (),
    "system/state_directory.py: f'{stored.damage}: {used}'": (
        "mission.plan.0 is damaged: there is no mission",
        "resume.state.1 is missing: the other slot is used, perhaps an older version",
    ),
    "system/state_directory.py: stored.damage": ("params.parm.0 cannot be read (Permission denied)",),
    "system/store.py: self._finish_import(strict=not wait) or self.obstacle": (
        "state directory state: import.pending is damaged",
    ),
    "system/store.py: self._hold.take(strict=not wait)": ("state directory state: busy; choose another with --state",),
    "system/store.py: str(error)": (),
}
TOLD = (*told(), *((text, place) for place, texts in HANDED_ON.items() for text in texts))


def words(form):
    """Return what a form says beside its holes."""
    return re.sub(r"<[^<>]*>|PreArm", "", form)


def is_handed_on(form):
    return not re.search("[a-z]{3}", words(form))


def test_every_text_that_can_be_told_has_an_entry():
    missing = {
        f"{form!r} ({place})"
        for form, place in TOLD
        if not is_handed_on(form) and not any(pattern.fullmatch(form) for pattern in PATTERNS.values())
    }
    assert not missing, (
        "texts without an entry: give each a row (text, what it means, what to do) in the module of "
        "firmware_py/cli/texts/ where it fits, with <words> for what is put in, then `make pages`:\n"
        + "\n".join(sorted(missing))
    )


def test_what_is_handed_on_is_known():
    found = {place for form, place in TOLD if is_handed_on(form)}
    assert found == set(HANDED_ON), (
        "a text that is made elsewhere is told here: name the place in HANDED_ON, with the texts unless a maker in "
        f"support.told_texts has them; or take away what is gone: {sorted(found ^ set(HANDED_ON))}"
    )


@pytest.mark.parametrize("text", sorted(ENTRIES))
def test_every_entry_is_of_a_text_that_can_be_told(text):
    assert any(PATTERNS[text].fullmatch(form) for form, _ in TOLD)


@pytest.mark.parametrize("text", sorted(ENTRIES))
def test_an_entry_says_more_than_its_text(text):
    assert words(text).strip(" :,.;")
    assert all(part.strip() for part in ENTRIES[text])


def test_every_fault_has_a_remedy():
    assert set(REMEDIES) == set(Fault)


def test_the_page_has_every_text_and_every_fault():
    page = markdown()
    assert all(row.text in page and row.recovery in page for row in TABLE.values())
    assert page.count("\n| ") >= len(ENTRIES) + len(TABLE)
