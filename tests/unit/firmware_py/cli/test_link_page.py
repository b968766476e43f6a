"""The page of messages and commands knows every one of them."""

from firmware_py.__main__ import main
from support.paths import ROOT


def test_the_page_has_every_row_and_every_message_that_is_heard(capsys):
    assert main(["params", "--messages"]) == 0
    page = capsys.readouterr().out
    assert page == (ROOT / "params/MESSAGES.md").read_text(encoding="utf-8")
    for heard in ("| 76 | COMMAND_LONG | ", "| 86 | SET_POSITION_TARGET_GLOBAL_INT | Go to", "| 80 | COMMAND_CANCEL |"):
        assert heard in page
    answers = page.rpartition("## Replies")[2]
    for name in ("COMMAND_ACK", "STATUSTEXT", "PARAM_VALUE", "AVAILABLE_MODES", "AUTOPILOT_VERSION", "TIMESYNC"):
        assert name in answers
    assert "HEARTBEAT" not in answers
