"""The page of messages and commands is complete."""

from firmware_py.__main__ import main
from support.paths import ROOT


def test_page_has_every_row_and_message(capsys):
    assert main(["params", "--messages"]) == 0
    page = capsys.readouterr().out
    assert page == (ROOT / "params/MESSAGES.md").read_text(encoding="utf-8")
    for row in ("| 76 | COMMAND_LONG | ", "| 86 | SET_POSITION_TARGET_GLOBAL_INT | Go to", "| 80 | COMMAND_CANCEL |"):
        assert row in page
    replies = page.rpartition("## Replies")[2]
    for name in ("COMMAND_ACK", "STATUSTEXT", "PARAM_VALUE", "AVAILABLE_MODES", "AUTOPILOT_VERSION", "TIMESYNC"):
        assert name in replies
    assert "HEARTBEAT" not in replies
