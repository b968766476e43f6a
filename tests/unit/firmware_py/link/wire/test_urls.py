"""The options behind the question mark of a link's URL."""

import pytest

from firmware_py.link.wire.urls import (
    PLAIN,
    LinkClass,
    LinkError,
    LinkOptions,
    OptionError,
    Policy,
    parse_options,
    parse_url,
)


def test_all_options():
    url = parse_url("udpin:0.0.0.0:14550?trusted=1&policy=signed-commands&class=satellite&systems=255,250")
    assert (url.kind, url.host, url.number) == ("udpin", "0.0.0.0", 14550)
    assert url.options == LinkOptions(
        trusted=True,
        policy=Policy.SIGNED_COMMANDS,
        link_class=LinkClass.SATELLITE,
        systems=frozenset({255, 250}),
    )


def test_without_options_all_is_as_ever():
    assert parse_url("serial:/dev/ttyS0:57600").options == PLAIN
    assert LinkOptions(trusted=False, policy=Policy.AUTO, link_class=None, systems=None) == PLAIN


@pytest.mark.parametrize(
    ("text", "rates"), [("class=fast", False), ("class=radio", True), ("class=satellite", True), ("trusted=no", None)]
)
def test_the_class_of_a_link_goes_over_what_its_kind_suggests(text, rates):
    options = parse_options(text)
    for usual in (False, True):
        assert options.at_radio_rates(usual=usual) is (usual if rates is None else rates)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is not known; there are trusted, policy"),
        ("polcy=open", "did you mean 'policy'"),
        ("policy", "policy='': allowed are auto, open"),
        ("policy=signed", "allowed are auto, open, signed-commands, signed-only"),
        ("trusted=maybe", "allowed are 1 or 0"),
        ("trusted=1\n", "allowed are 1 or 0"),
        ("class=slow", "allowed are fast, radio, satellite"),
        ("systems=", "system ids from 1 to 255"),
        ("systems=0", "system ids from 1 to 255"),
        ("systems=256", "system ids from 1 to 255"),
        ("systems=1,,2", "system ids from 1 to 255"),
        ("systems=\u0663", "system ids from 1 to 255"),
        ("systems=99999999999999999999", "system ids from 1 to 255"),
        (f"systems=0001{'9' * 5000}", "system ids from 1 to 255"),
        ("\1" * 5000, "is not known"),
        ("\0" * 5000, "is not known|holds a NUL"),  # which no URL may, whatever its options
        ("trusted=1&trusted=1", "given twice"),
        ("trusted=1&", "is not known"),
    ],
)
def test_a_wrong_option_is_one_line_that_says_what_is_allowed(text, says):
    with pytest.raises(OptionError, match=says):
        parse_options(text)
    with pytest.raises(LinkError, match=says) as caught:
        parse_url(f"udpin:0.0.0.0:14550?{text}")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 1000
