"""The page of messages and commands knows every one of them."""

from firmware_py.__main__ import main
from firmware_py.link.commands.table import TABLE as COMMANDS
from firmware_py.link.telemetry.table import TABLE as TELEMETRY


def test_the_page_has_every_row_and_every_message_that_is_heard(capsys):
    assert main(["params", "--messages"]) == 0
    page = capsys.readouterr().out
    for row in COMMANDS:
        assert f"| {row.command} | {row.name} | {row.text} |" in page
    for row in TELEMETRY:
        assert f"| {row.number} | {row.name} | {row.fast_hz:g} | {row.radio_hz:g} |" in page
    for heard in ("| 76 | COMMAND_LONG | ", "| 86 | SET_POSITION_TARGET_GLOBAL_INT | Go to", "| 80 | COMMAND_CANCEL |"):
        assert heard in page
    answers = page.rpartition("## Answers")[2]
    for name in ("COMMAND_ACK", "STATUSTEXT", "PARAM_VALUE", "AVAILABLE_MODES", "AUTOPILOT_VERSION", "TIMESYNC"):
        assert name in answers
    assert "HEARTBEAT" not in answers
