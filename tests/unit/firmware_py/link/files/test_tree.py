"""Paths of file transfer, and the areas that contain them."""

import errno
from pathlib import Path

import pytest

from firmware_py.link.files.area import Area
from firmware_py.link.files.payload import Error, Refusal
from firmware_py.link.files.tree import Tree, parse_path

TREE = Tree(
    {"logs": Area(Path("/none"), writable=False), "uploads": Area(Path("/none"), writable=True)},
    {("@PARAM", "param.pck"): lambda _query: b"12", ("boat.param",): lambda _query: b"1"},
    {("@MISSION", "mission.dat"): lambda *_: None},
)


@pytest.mark.parametrize(
    ("raw", "parts", "query"),
    [
        (b"", (), {}),
        (b"//a/./b/", ("a", "b"), {}),
        (b"a b\0c", ("a b",), {}),
        (b"@PARAM/param.pck?start=1&count=&&x", ("@PARAM", "param.pck"), {"start": "1", "count": "", "x": ""}),
        (b"a/b/c/d/e", ("a", "b", "c", "d", "e"), {}),
        (b"~" * 64, ("~" * 64,), {}),
    ],
)
def test_path_has_parts_and_a_query(raw, parts, query):
    assert parse_path(raw) == (parts, query)


@pytest.mark.parametrize(
    ("raw", "error", "number"),
    [
        *((raw, Error.FAIL_ERRNO, errno.EINVAL) for raw in (b"a\x1f", b"a\x7f", b"\xff")),
        *((raw, Error.FAIL_ERRNO, errno.ENAMETOOLONG) for raw in (b"a/b/c/d/e/f", b"a/" + b"n" * 65)),
        *((raw, Error.FILE_PROTECTED, 0) for raw in (b"..", b"a/../b", b"a/.hidden")),
    ],
)
def test_path_that_is_not_allowed_is_refused(raw, error, number):
    with pytest.raises(Refusal) as raised:
        parse_path(raw)
    assert (raised.value.error, raised.value.number) == (error, number)


@pytest.mark.parametrize(
    ("parts", "reading", "writing"),
    [
        (("logs", "a"), ("logs", ("a",)), Error.FILE_PROTECTED),
        (("uploads", "d", "a"), ("uploads", ("d", "a")), ("uploads", ("d", "a"))),
        ((), Error.FILE_NOT_FOUND, Error.FILE_PROTECTED),
        (("none",), Error.FILE_NOT_FOUND, Error.FILE_PROTECTED),
        (("none", "a"), Error.FILE_NOT_FOUND, Error.FILE_NOT_FOUND),
        (("boat.param",), Error.FILE_NOT_FOUND, Error.FILE_PROTECTED),
        (("@PARAM", "a"), Error.FILE_NOT_FOUND, Error.FILE_PROTECTED),
        (("@MISSION", "a"), Error.FILE_NOT_FOUND, Error.FILE_PROTECTED),
    ],
)
def test_area_of_a_path(parts, reading, writing):
    for write, expected in ((False, reading), (True, writing)):
        if isinstance(expected, Error):
            with pytest.raises(Refusal) as raised:
                TREE.find_area(parts, write=write)
            assert raised.value.error == expected
        else:
            assert TREE.find_area(parts, write=write) == (TREE.areas[expected[0]], expected[1])


def test_directories_of_generated_files_are_listed():
    directories = [(name, True, 0, 0) for name in ("@MISSION", "@PARAM", "logs", "uploads")]
    assert list(TREE.list_directory(())) == [*directories[:2], ("boat.param", False, 1, 0), *directories[2:]]
    assert TREE.list_directory(("@PARAM",)) == (("param.pck", False, 2, 0),)
    with pytest.raises(Refusal):
        TREE.list_directory(("@MISSION",))
