"""Each STATUSTEXT has an entry on the page of texts, and each entry a text."""

import re

import pytest

from firmware_py.cli.text_page import SECTIONS
from support.status_texts import status_texts

ENTRIES = {text: row for section in SECTIONS.values() for text, row in section.items()}
PATTERNS = {
    text: re.compile("(?s)" + ".+".join(re.escape(part) for part in re.split("<[^<>]*>", text))) for text in ENTRIES
}
# Texts composed of parts, which support.status_texts does not find.
COMPOSED = (
    "AIS: another station uses the boat's MMSI 235000007",
    "Mission item 2 is 778 m outside the fence",
    "Leg to mission item 2 leaves the fence by 55 m",
    "mission.plan.0 is damaged: there is no mission",
    "resume.state.0 is of another version: not resumed",
    "resume.record.1 is missing: the other slot is used, perhaps an older version",
    "params.parm.0 cannot be read (Permission denied)",
    "state directory state: import.pending is damaged",
    "Import not used: import.pending is damaged",
    "state directory state: busy; choose another with --state",
    "Port /dev/ttyS1: changed by another program, restored; open in gpsd (process 812)",
    "Port /dev/ttyS1: also open in gpsd (process 812); end that program",
)


def words(form):
    """Return a text without its placeholders."""
    return re.sub(r"<[^<>]*>|PreArm", "", form)


@pytest.fixture(scope="module")
def forms():
    """Each text and its location. Texts of placeholders only forward a text created elsewhere."""
    found = {form: place for form, place in status_texts() if re.search("[a-z]{3}", words(form))}
    return found | dict.fromkeys(COMPOSED, "")


def test_every_text_has_an_entry(forms):
    missing = [f"{form!r} ({place})" for form, place in forms.items() if not any(entries_of(form))]
    assert not missing, (
        "texts without an entry: give each a row (text, meaning, what to do) in texts.py "
        "beside the code that sends it, with <words> for what is put in, then `make pages`:\n"
        + "\n".join(sorted(missing))
    )


def entries_of(form):
    """Yield the entries that describe a text."""
    return (text for text, pattern in PATTERNS.items() if pattern.fullmatch(form))


def test_every_entry_has_a_text(forms):
    described = {text for form in forms for text in entries_of(form)}
    assert set(ENTRIES) - described == set()


def test_every_entry_has_meaning_and_remedy():
    for text, parts in ENTRIES.items():
        assert words(text).strip(" :,.;"), text
        assert all(part.strip() for part in parts), text
