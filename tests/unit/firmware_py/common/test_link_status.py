from firmware_py.common.link_status import session_error_text

# MO session status of +SBDIX, ISU AT Command Reference.
STATUSES = (*range(10, 20), *range(32, 39))


def test_failed_session_has_a_reason_and_its_number():
    texts = [session_error_text(status) for status in STATUSES]
    assert len(set(texts)) == len(STATUSES)
    assert not any("not known" in text for text in texts)
    assert session_error_text(36) == "status 36, wait 3 min"
    assert session_error_text(9) == "status 9, not known"
    assert session_error_text(None) == "modem fell silent"


def test_reason_belongs_to_its_status():
    texts = (
        "no end in time", "gateway's queue full", "too many segments", "no end", "false segment size", "access denied",
        "modem locked", "gateway silent", "connection lost", "link failed", "no service", "antenna fault",
        "radio disabled", "modem busy", "wait 3 min", "service disabled", "traffic held up",
    )  # fmt: skip
    for status, text in zip(STATUSES, texts, strict=True):
        assert session_error_text(status) == f"status {status}, {text}"
