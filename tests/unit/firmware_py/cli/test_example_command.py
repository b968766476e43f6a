"""`rambler example`: a new vehicle file, never an existing one."""

import pytest

from firmware_py.__main__ import main
from firmware_py.vehicle import load
from support.paths import ROOT


@pytest.mark.parametrize(
    ("words", "name"), [((), "ocean_rambler.toml"), (("--kind", "shared-port"), "shared_port_volz.toml")]
)
def test_example_is_written_with_its_directory(words, name, tmp_path, capsys):
    path = tmp_path / "new" / "boat.toml"
    assert main(["example", str(path), *words]) == 0
    assert path.read_text() == (ROOT / "params" / name).read_text()
    load(path)
    first, second = capsys.readouterr().out.splitlines()
    assert (first, second.endswith(f"rambler check {path}")) == (f"wrote {path}", True)


def test_existing_file_link_or_directory_is_kept(tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to("nowhere")
    for name, text in (("file", "exists"), ("link", "exists"), (".", "is a directory")):
        assert main(["example", str(tmp_path / name)]) == 2
        assert text in capsys.readouterr().err
    assert ((tmp_path / "file").read_text(), (tmp_path / "nowhere").exists()) == ("mine", False)
