"""The version as the commands say it: from a checkout, from a built package, from neither."""

import subprocess

import pytest

import firmware_py
import firmware_py.__main__
import hil.__main__
from firmware_py import COMMIT_FILE, ROOT, commit_of, commit_utc_s_of, version_text


def git(folder, *words):
    identity = ("-c", "user.name=A", "-c", "user.email=a@example.org")
    return subprocess.run(
        ("git", *identity, *words), cwd=folder, check=True, capture_output=True, text=True
    ).stdout.strip()


@pytest.fixture
def checkout(tmp_path):
    """A repository with one commit and the tag that must not be taken for it."""
    git(tmp_path, "init", "-q")
    (tmp_path / "boat").write_text("content")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "First")
    git(tmp_path, "tag", "-a", "v9", "-m", "not a commit")
    return tmp_path


@pytest.fixture
def package(tmp_path):
    """A tree as a built package has it: no repository, the commit in a file."""
    file = tmp_path / COMMIT_FILE
    file.parent.mkdir(parents=True)
    file.write_text("0123abcd\n")
    return tmp_path


def test_a_checkout_has_its_commit(checkout):
    found = commit_of(checkout)
    assert len(found) == 8
    assert git(checkout, "rev-parse", "HEAD").startswith(found)


def test_a_modified_checkout_is_dirty(checkout):
    clean = commit_of(checkout)
    (checkout / "boat").write_text("aground")
    assert commit_of(checkout) == f"{clean}-dirty"


def test_a_built_package_has_its_commit(package):
    assert commit_of(package) == "0123abcd"


@pytest.mark.parametrize(
    ("text", "commit", "utc_s"),
    [
        ("0123abcd\n1700000000\n", "0123abcd", 1_700_000_000),
        ("0123abcd\n", "0123abcd", None),
        ("0\nyesterday", "0", None),
    ],
)
def test_a_built_package_has_its_commit_time(package, text, commit, utc_s):
    (package / COMMIT_FILE).write_text(text)
    assert (commit_of(package), commit_utc_s_of(package)) == (commit, utc_s)


def test_a_tree_inside_another_repository_has_no_commit(checkout):
    inside = checkout / "site-packages"
    inside.mkdir()
    assert commit_of(inside) == ""


@pytest.mark.parametrize("content", [b"", b"\xff\xfe"], ids=["empty", "not text"])
def test_a_damaged_commit_file_is_an_unknown_commit(package, content):
    (package / COMMIT_FILE).write_bytes(content)
    assert commit_of(package) == ""


def test_a_checkout_without_git_on_the_machine_is_an_unknown_commit(checkout, monkeypatch):
    monkeypatch.setenv("PATH", str(checkout))
    assert commit_of(checkout) == ""


def test_a_repository_without_a_commit_is_an_unknown_commit(tmp_path):
    git(tmp_path, "init", "-q")
    assert commit_of(tmp_path) == ""


@pytest.mark.parametrize("command", [firmware_py.__main__, hil.__main__], ids=["rambler", "rambler-hil"])
def test_both_commands_print_version_and_commit(command, capsys):
    with pytest.raises(SystemExit) as ended:
        command.main(["--version"])
    assert ended.value.code == 0
    program, version, *commit = capsys.readouterr().out.split()
    assert (program, version) in [("rambler", firmware_py.__version__), ("rambler-hil", firmware_py.__version__)]
    known = commit_of(ROOT)
    assert commit == (["(git", f"{known})"] if known else [])


def test_an_unknown_commit_is_left_out():
    assert version_text("rambler", "") == f"rambler {firmware_py.__version__}"
