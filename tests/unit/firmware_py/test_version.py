"""Version and commit in a checkout, in a built package, and without either."""

import subprocess

import pytest

import firmware_py
import firmware_py.__main__
import hil.__main__
from firmware_py import COMMIT_FILE, ROOT, commit_of, commit_utc_s_of, version_text


def git(folder, *arguments):
    identity = ("-c", "user.name=A", "-c", "user.email=a@example.org")
    return subprocess.run(
        ("git", *identity, *arguments), cwd=folder, check=True, capture_output=True, text=True
    ).stdout.strip()


@pytest.fixture
def checkout(tmp_path):
    """A repository with one commit, and a tag that must not be reported."""
    git(tmp_path, "init", "-q")
    (tmp_path / "boat").write_text("content")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-q", "-m", "First")
    git(tmp_path, "tag", "-a", "v9", "-m", "not a commit")
    return tmp_path


@pytest.fixture
def package(tmp_path):
    """The tree of a built package: the commit in a file, no repository."""
    file = tmp_path / COMMIT_FILE
    file.parent.mkdir(parents=True)
    file.write_text("0123abcd\n")
    return tmp_path


def test_commit_of_a_checkout(checkout):
    commit = commit_of(checkout)
    assert len(commit) == 8
    assert git(checkout, "rev-parse", "HEAD").startswith(commit)
    (checkout / "boat").write_text("changed")
    assert commit_of(checkout) == f"{commit}-dirty"


@pytest.mark.parametrize(
    ("text", "commit", "utc_s"),
    [
        ("0123abcd\n1700000000\n", "0123abcd", 1_700_000_000),
        ("0123abcd\n", "0123abcd", None),
        ("0\nyesterday", "0", None),
    ],
)
def test_commit_and_time_of_a_built_package(package, text, commit, utc_s):
    (package / COMMIT_FILE).write_text(text)
    assert (commit_of(package), commit_utc_s_of(package)) == (commit, utc_s)


def test_folder_in_another_repository_has_no_commit(checkout):
    inside = checkout / "site-packages"
    inside.mkdir()
    assert commit_of(inside) == ""


@pytest.mark.parametrize("content", [b"", b"\xff\xfe"], ids=["empty", "not text"])
def test_damaged_commit_file_is_an_unknown_commit(package, content):
    (package / COMMIT_FILE).write_bytes(content)
    assert commit_of(package) == ""


def test_checkout_without_git_or_without_a_commit_is_an_unknown_commit(checkout, tmp_path, monkeypatch):
    git(tmp_path, "init", "-q", "empty")
    assert commit_of(tmp_path / "empty") == ""
    monkeypatch.setenv("PATH", str(checkout))
    assert commit_of(checkout) == ""


@pytest.mark.parametrize("command", [firmware_py.__main__, hil.__main__], ids=["rambler", "rambler-hil"])
def test_both_commands_print_version_and_commit(command, capsys):
    with pytest.raises(SystemExit) as ended:
        command.main(["--version"])
    assert ended.value.code == 0
    program, version, *commit = capsys.readouterr().out.split()
    assert (program, version) in [("rambler", firmware_py.__version__), ("rambler-hil", firmware_py.__version__)]
    known = commit_of(ROOT)
    assert commit == (["(git", f"{known})"] if known else [])


def test_unknown_commit_is_omitted():
    assert version_text("rambler", "") == f"rambler {firmware_py.__version__}"
