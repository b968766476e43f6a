"""Bundles: integrity, signatures, versions."""

import io
import json
import shutil
import subprocess
import tarfile

import pytest

from firmware_py.install.bundle import (
    LIST,
    SIGNATURE,
    UpdateError,
    check_computer,
    is_older,
    read_list,
    unpack,
    version_key,
)
from support.small_bundle import load_bundle_maker

FILES = {"a-1.0-py3-none-any.whl": b"x" * 700, "requirements.txt": b"a==1.0\n", "pip-25.3-py3-none-any.whl": b""}
KEYGEN = shutil.which("ssh-keygen")


@pytest.fixture
def make(tmp_path):
    def create(version="0.2.0", utc_s=1000, key=None, name="b.bundle", files=FILES):
        (folder := tmp_path / f"files of {name}").mkdir()
        for file, content in files.items():
            (folder / file).write_bytes(content)
        load_bundle_maker().write_bundle(folder, tmp_path / name, version, "abcd1234", utc_s, key)
        return tmp_path / name

    return create


def refusal(path, folder, signers=None):
    shutil.rmtree(folder, ignore_errors=True)
    with pytest.raises(UpdateError) as error:
        unpack(path, folder, signers)
    return str(error.value)


def repack(path, change):
    """Change the members of a bundle."""
    with tarfile.open(path) as archive:
        members = [(member, archive.extractfile(member).read()) for member in archive]
    with tarfile.open(path, "w:") as archive:
        for member, content in change(members):
            member.size = len(content) if member.isreg() else 0
            archive.addfile(member, io.BytesIO(content))
    return path


def test_bundle_round_trip(make, tmp_path):
    bundle = unpack(make(), tmp_path / "out", None)
    assert (bundle.version, bundle.commit, bundle.commit_utc_s) == ("0.2.0", "abcd1234", 1000)
    assert bundle.title == "0.2.0 (git abcd1234)"
    assert {name: (tmp_path / "out" / name).read_bytes() for name in FILES} == FILES
    assert read_list((tmp_path / "out" / LIST).read_bytes()) == bundle
    assert bundle.wheel_of("pip") == "pip-25.3-py3-none-any.whl"
    with pytest.raises(UpdateError, match="no wheel of numpy"):
        bundle.wheel_of("numpy")


def test_same_files_make_the_same_bundle(make):
    assert make(name="one").read_bytes() == make(name="two").read_bytes()


def test_truncated_bundle_is_refused(make, tmp_path):
    path = make()
    content = path.read_bytes()
    with tarfile.open(path) as archive:
        end = max(member.offset_data + member.size for member in archive)
    for length in (*range(0, end, 97), end - 1):
        path.write_bytes(content[:length])
        assert "copy it again" in (output := refusal(path, tmp_path / "out")) or "not a bundle" in output, length


def test_changed_byte_is_detected_or_has_no_effect(make, tmp_path):
    path = make()
    content = path.read_bytes()
    for offset in range(0, len(content), 61):
        path.write_bytes(content[:offset] + bytes([content[offset] ^ 0x55]) + content[offset + 1 :])
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        try:
            unpack(path, tmp_path / "out", None)
        except UpdateError:
            continue
        assert {name: (tmp_path / "out" / name).read_bytes() for name in FILES} == FILES, offset


def link_last(members):
    members[-1][0].type, members[-1][0].linkname = tarfile.SYMTYPE, "/etc/passwd"
    return members


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda members: [*members, (tarfile.TarInfo("more.whl"), b"")], "'more.whl', which is not in its list"),
        (lambda members: [*members, members[-1]], "is not in its list"),
        (link_last, "has 0 bytes"),
    ],
    ids=["unlisted file", "repeated file", "link"],
)
def test_changed_members_are_refused(make, tmp_path, change, text):
    assert text in refusal(repack(make(), change), tmp_path / "out")


@pytest.mark.parametrize("name", ["../evil", "/etc/evil", "a/b", "", ".hidden", "x" * 300])
def test_path_names_are_refused(name):
    files = {name: {"bytes": 1, "sha256": "0" * 64}}
    data = {"format": 1, "version": "1.0.0", "commit": "", "commit_utc_s": 0, "files": files}
    with pytest.raises(UpdateError, match="invalid entry"):
        read_list(json.dumps(data).encode())


@pytest.mark.parametrize("content", [b"", b"[]", b"{}", b"\xff", b'{"format": 2}', b"[" * 100_000, b'{"format": 1}'])
def test_invalid_list_is_a_one_line_error(content):
    with pytest.raises(UpdateError) as error:
        read_list(content)
    assert "\n" not in str(error.value)


@pytest.fixture
def key(tmp_path):
    if KEYGEN is None:
        pytest.skip("ssh-keygen is not installed (openssh-client)")

    def create(name):
        command = [KEYGEN, "-q", "-t", "ed25519", "-N", "", "-C", name, "-f", str(tmp_path / name)]
        subprocess.run(command, check=True)
        return tmp_path / name

    return create


@pytest.fixture
def signers(tmp_path, key):
    public = key("owner").with_suffix(".pub").read_text()
    (tmp_path / "signers").write_text(f"rambler {public}")
    return tmp_path / "signers"


def test_only_signed_bundles_are_accepted(make, tmp_path, key, signers):
    assert unpack(make(key=tmp_path / "owner"), tmp_path / "out", signers).version == "0.2.0"
    assert unpack(tmp_path / "b.bundle", tmp_path / "out2", None).version == "0.2.0"
    assert "not signed, but" in refusal(make(name="unsigned"), tmp_path / "out", signers)
    assert "not signed by one of" in refusal(make(name="stranger", key=key("stranger")), tmp_path / "out", signers)


def test_signature_covers_the_list_and_is_checked_first(make, tmp_path, signers):
    signed = make(key=tmp_path / "owner")
    with tarfile.open(signed) as archive:
        signature = archive.extractfile(SIGNATURE).read()
    other = make(version="0.3.0", name="other", key=tmp_path / "owner")

    def replace_signature(members):
        return [(member, signature if member.name == SIGNATURE else content) for member, content in members]

    assert "not signed by one of" in refusal(repack(other, replace_signature), tmp_path / "out", signers)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {SIGNATURE}


def test_signature_of_another_namespace_is_refused(make, tmp_path, signers):
    def sign_for_files(members):
        content = members[0][1]
        command = [KEYGEN, "-Y", "sign", "-f", str(tmp_path / "owner"), "-n", "file"]
        signature = subprocess.run(command, input=content, check=True, capture_output=True).stdout
        return [members[0], (tarfile.TarInfo(SIGNATURE), signature), *members[2:]]

    signed = make(key=tmp_path / "owner")
    assert "not signed by one of" in refusal(repack(signed, sign_for_files), tmp_path / "out", signers)


def test_versions_are_ordered():
    order = ["0.1.0.dev0", "0.1.0.dev1", "0.1.0a1", "0.1.0rc1", "0.1.0", "0.1.1.dev0", "0.2.0", "0.10.0", "1.0.0"]
    assert sorted(order, key=version_key) == order
    for text in ("", "1", "1.0", "1.0.0.0", "1.0.0+local", "v1.0.0", "1.0.x"):
        with pytest.raises(UpdateError):
            version_key(text)


@pytest.mark.parametrize(
    ("version", "commit_utc_s", "expected"),
    [
        ("0.3.0", None, True),
        ("0.2.0", None, False),
        ("0.2.0", 2000, True),
        ("0.2.0", 1000, False),
        ("0.1.9", 9000, False),
    ],
)
def test_older_by_version_then_by_commit_time(make, tmp_path, version, commit_utc_s, expected):
    assert is_older(unpack(make(), tmp_path / "out", None), version, commit_utc_s) is expected


@pytest.mark.parametrize(
    ("machine", "python", "is_refused"),
    [
        ("aarch64", (3, 13), False),
        ("aarch64", (3, 11), False),
        ("aarch64", (3, 12), True),
        ("x86_64", (3, 13), True),
    ],
)
def test_bundle_for_other_computers_names_the_make_command(make, machine, python, is_refused):
    names = [f"lxml-6.1-cp{n}-cp{n}-manylinux_2_26_aarch64.manylinux_2_28_aarch64.whl" for n in (311, 313)]
    more = ["fastcrc-0.5-cp37-abi3-manylinux2014_aarch64.whl", "fastcrc-0.5-cp37-abi3-manylinux2014_x86_64.whl"]
    more += ["pyserial-3.5-py2.py3-none-any.whl", "hidapi-1.0-1-py3-none-manylinux_2_17_aarch64.whl"]
    path = make(files=FILES | dict.fromkeys((*names, *more), b""))
    bundle = unpack(path, path.with_name("out"), None)
    if not is_refused:
        check_computer(bundle, machine, python)
    else:
        remedy = rf"for other computers .*; make bundle FOR={machine}:{python[0]}\.{python[1]}$"
        with pytest.raises(UpdateError, match=remedy):
            check_computer(bundle, machine, python)
