"""`rambler-hil sbd-gateway` goes on whatever a message or a directory holds."""

from types import SimpleNamespace

import pytest

from hil.cli.sbd_gateway import _Outbox, _survive
from hil.devices.message_post import TO_BOAT, MessagePost


@pytest.mark.parametrize(
    "error", [NotImplementedError("?"), UnicodeDecodeError("utf-8", b"x", 0, 1, "bad"), KeyError(1)]
)
def test_what_is_wrong_with_a_message_is_reported_and_the_next_one_is_due(error):
    said = []

    def work():
        raise error

    gateway = SimpleNamespace(complain=said.append)
    assert _survive(gateway, work) is None
    assert said == [f"Message left out: {type(error).__name__}: {error}"]
    assert _survive(gateway, lambda: 7) == 7


def test_an_order_that_cannot_be_left_for_the_boat_is_reported(tmp_path):
    post = MessagePost(tmp_path, TO_BOAT)
    outbox = _Outbox(post, None)
    post.directory.rename(tmp_path / "away")
    outbox.hand_over("300234010753370", b"order")
    assert outbox.problems == [f"Not sent: {post.directory}: No such file or directory"]
    outbox.close()
