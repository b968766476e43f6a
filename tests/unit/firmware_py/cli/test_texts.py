"""Each STATUSTEXT has an entry on the page of texts, and each entry belongs to a STATUSTEXT."""

import re

import pytest

from firmware_py.cli.text_page import SECTIONS
from support.status_texts import status_texts

ENTRIES = {text: row for section in SECTIONS.values() for text, row in section.items()}
PATTERNS = {
    text: re.compile("(?s)" + ".+".join(re.escape(part) for part in re.split("<[^<>]*>", text))) for text in ENTRIES
}
# Texts composed of parts, which support.status_texts does not find.
COMPOSED_TEXTS = (
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
    "[compass]: package rambler-os5000 1.0: rambler_os5000:DRIVER: ImportError: x; correct or remove it",
    "Compass: driver of package rambler-os5000 1.0: KeyError: 'R' (rambler_os5000.py:92)",
)


def without_placeholders(text):
    """Return a text without placeholders and PreArm."""
    return re.sub(r"<[^<>]*>|PreArm", "", text)


@pytest.fixture(scope="module")
def texts():
    """Return the location of each text, except texts that only forward one created elsewhere."""
    locations = {
        text: location for text, location in status_texts() if re.search("[a-z]{3}", without_placeholders(text))
    }
    return locations | dict.fromkeys(COMPOSED_TEXTS, "")


def test_every_text_has_an_entry(texts):
    missing = [f"{text!r} ({location})" for text, location in texts.items() if not any(matching_entries(text))]
    assert not missing, (
        "texts without an entry: add a row (text, meaning, what to do) to texts.py beside the code that sends it, "
        "with <words> as placeholders, then `make pages`:\n" + "\n".join(sorted(missing))
    )


def matching_entries(text):
    """Yield the entries whose pattern matches a text."""
    return (entry for entry, pattern in PATTERNS.items() if pattern.fullmatch(text))


def test_every_entry_has_a_text(texts):
    described_entries = {entry for text in texts for entry in matching_entries(text)}
    assert set(ENTRIES) - described_entries == set()


def test_every_entry_has_meaning_and_remedy():
    for text, row in ENTRIES.items():
        assert without_placeholders(text).strip(" :,.;"), text
        assert all(cell.strip() for cell in row), text
