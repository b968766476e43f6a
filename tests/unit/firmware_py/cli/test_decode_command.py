"""`rambler decode`: messages and errors of a capture."""

import json

from firmware_py.__main__ import main


def test_messages_and_errors_are_printed_and_unusable_files_refused(capsys, tmp_path):
    file = tmp_path / "capture.nmea"
    file.write_text("$HEHDT,341.8,T*21\r\n$HEHDT,341.8,T*22\r\n")
    assert main(["decode", "nmea", str(file), "--json"]) == 0
    heading, error = map(json.loads, capsys.readouterr().out.splitlines())
    assert (heading["line"], heading["type"], heading["heading_true_deg"]) == (1, "heading", 341.8)
    assert main(["decode", "nmea", str(file)]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2
    with (tmp_path / "huge").open("wb") as huge:
        huge.truncate((256 << 20) + 1)
    assert main(["decode", "nmea", str(tmp_path / "huge")]) == 2
    assert "large" in capsys.readouterr().err
    assert main(["decode", "pigeon", str(file)]) == 2
    assert "pigeon" in capsys.readouterr().err
    assert (error["line"], error["type"], error["error"]) == (2, "error", "checksum")
    assert main(["decode", "nmea", str(tmp_path / "none")]) == 2
    assert (
        capsys.readouterr().err == f"rambler decode: {tmp_path / 'none'}: cannot be read: No such file or directory\n"
    )
    file.write_text("a wrong file\n")
    assert main(["decode", "nmea", str(file)]) == 0
    assert capsys.readouterr() == ("", f"rambler decode: {file}: no nmea message in 13 bytes; check KIND\n")
