"""Every input of the corpus is taken or refused as it should be; among them all that fuzzing has ever found."""

import pytest

from fuzz.engine import CORPUS, culprit, minimised
from fuzz.link import MESSAGES, handled_messages
from fuzz.table import TARGETS
from fuzz.target import Target, joined, records

MOST_BYTES = 1 << 20


@pytest.mark.parametrize("name", TARGETS)
def test_a_target_takes_its_corpus(name):
    inputs = sorted((CORPUS / name).iterdir())
    for path in inputs:
        try:
            TARGETS[name].play(path.read_bytes())
        except Exception as error:
            error.add_note(f"input {path}")
            raise
    assert len(inputs) > 0


def test_every_directory_of_the_corpus_has_a_target_and_all_are_small():
    assert {path.name for path in CORPUS.iterdir()} == set(TARGETS)
    assert sum(path.stat().st_size for path in CORPUS.rglob("*")) < MOST_BYTES


def test_every_message_that_the_link_hears_is_in_a_target():
    assert set().union(*MESSAGES.values()) == handled_messages()


def test_an_input_is_made_of_records_and_any_bytes_are_an_input():
    pairs = [(0, b""), (255, bytes(255)), (7, b"body")]
    assert list(records(joined(pairs))) == pairs
    assert list(records(b"\x07\x04bo")) == [(7, b"bo")]
    assert list(records(b"\x07")) == [(7, b"")]


def picky(data):
    if b"bad" in data:
        raise KeyError
    if b"no" in data:
        raise ValueError("not this one")


def test_what_a_target_may_refuse_is_no_finding_and_another_error_is():
    target = Target(picky, (ValueError,))
    assert target.play(b"x")
    assert not target.play(b"no")
    with pytest.raises(KeyError):
        target.play(b"bad")


def test_a_refusal_in_more_than_one_line_is_a_finding():
    def run(_data):
        raise ValueError("two\nlines")

    with pytest.raises(AssertionError):
        Target(run, (ValueError,)).play(b"")


def test_a_finding_is_made_short_and_stays_the_same_finding():
    target = Target(picky, (ValueError,))
    with pytest.raises(KeyError) as caught:
        target.play(b"bad")
    assert minimised(target, b"x" * 700 + b"bad" + b"no" * 50, culprit(caught.value)) == b"bad"
