"""Every input of the corpus, including all former findings, is accepted or refused without another error."""

import pytest

from fuzz.engine import CORPUS, finding_key, minimise
from fuzz.link import MESSAGES, handled_numbers
from fuzz.table import TARGETS
from fuzz.target import Target, join_records, records

MAX_CORPUS_BYTES = 1 << 20


@pytest.mark.parametrize("name", TARGETS)
def test_target_accepts_or_refuses_its_corpus(name):
    inputs = sorted((CORPUS / name).iterdir())
    for path in inputs:
        try:
            TARGETS[name].play(path.read_bytes())
        except Exception as error:
            error.add_note(f"input {path}")
            raise
    assert len(inputs) > 0


def test_every_directory_of_the_corpus_has_a_target_and_the_corpus_is_small():
    assert {path.name for path in CORPUS.iterdir()} == set(TARGETS)
    assert sum(path.stat().st_size for path in CORPUS.rglob("*")) < MAX_CORPUS_BYTES


def test_every_message_that_the_link_handles_is_in_a_target():
    assert set().union(*MESSAGES.values()) == handled_numbers()


def test_records_round_trip_and_truncated_records_are_valid():
    pairs = [(0, b""), (255, bytes(255)), (7, b"body")]
    assert list(records(join_records(pairs))) == pairs
    assert list(records(b"\x07\x04bo")) == [(7, b"bo")]
    assert list(records(b"\x07")) == [(7, b"")]


def raise_for_words(data):
    if b"bad" in data:
        raise KeyError
    if b"no" in data:
        raise ValueError("not this one")


def test_allowed_refusal_is_no_finding_and_another_error_is():
    target = Target(raise_for_words, (ValueError,))
    assert target.play(b"x")
    assert not target.play(b"no")
    with pytest.raises(KeyError):
        target.play(b"bad")


def test_refusal_of_two_lines_is_a_finding():
    def run(_data):
        raise ValueError("two\nlines")

    with pytest.raises(AssertionError):
        Target(run, (ValueError,)).play(b"")


def test_minimised_input_causes_the_same_finding():
    target = Target(raise_for_words, (ValueError,))
    with pytest.raises(KeyError) as caught:
        target.play(b"bad")
    assert minimise(target, b"x" * 700 + b"bad" + b"no" * 50, finding_key(caught.value)) == b"bad"
