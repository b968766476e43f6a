"""Reasons of refusals in file transfer."""

import errno

import pytest

from firmware_py.link.files.payload import Error, refusal_of


@pytest.mark.parametrize(
    ("failure", "reason"),
    [
        *((OSError(number, ""), (Error.FILE_NOT_FOUND, 0)) for number in (errno.ENOENT, errno.ENOTDIR)),
        *(
            (OSError(number, ""), (Error.FILE_PROTECTED, 0))
            for number in (errno.EACCES, errno.EPERM, errno.EROFS, errno.ELOOP)
        ),
        (OSError(errno.EEXIST, ""), (Error.FILE_EXISTS, 0)),
        (OSError(errno.EIO, ""), (Error.FAIL_ERRNO, 5)),
        (OSError(512 + 5, ""), (Error.FAIL_ERRNO, 5)),
        *((failure, (Error.FAIL, 0)) for failure in (OSError(), ValueError(5, ""))),
    ],
)
def test_failure_of_the_disk_has_its_reason(failure, reason):
    refusal = refusal_of(failure)
    assert (refusal.error, refusal.number) == reason
