"""`rambler-hil sbd-gateway` continues after errors in messages and directories."""

from types import SimpleNamespace

import pytest

from hil.cli.sbd_gateway import _call_safely, _Outbox
from hil.devices.message_post import TO_BOAT, MessagePost


@pytest.mark.parametrize(
    "error", [NotImplementedError("?"), UnicodeDecodeError("utf-8", b"x", 0, 1, "bad"), KeyError(1)]
)
def test_error_in_a_message_is_reported_and_ignored(error):
    problems = []

    def fail():
        raise error

    gateway = SimpleNamespace(report_problem=problems.append)
    assert _call_safely(gateway, fail) is None
    assert problems == [f"Message skipped: {type(error).__name__}: {error}"]
    assert _call_safely(gateway, lambda: 7) == 7


def test_message_that_cannot_be_stored_is_reported(tmp_path):
    post = MessagePost(tmp_path, TO_BOAT)
    outbox = _Outbox(post, None)
    post.directory.rename(tmp_path / "moved")
    outbox.deliver("300234010753370", b"order")
    assert outbox.problems == [f"Message not sent: {post.directory}: No such file or directory"]
    outbox.close()
