"""Debian packages as image content, with scripts in place of apt and dpkg-deb."""

import os
from pathlib import Path

import pytest

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.images import debian

URIS = """'http://mirror/libc6_2.36_amd64.deb' libc6_2.36_amd64.deb 100 MD5Sum:aa
'http://mirror/perl-base_5_amd64.deb' perl-base_5_amd64.deb 100 MD5Sum:bb
'http://mirror/python3-minimal_3.11_amd64.deb' python3-minimal_3.11_amd64.deb 200
"""
APT = '#!/bin/sh\necho "$@" >> {log}\ncase "$*" in *missing*) echo "E: Unable to locate package missing" >&2; exit 100;; *--print-uris*) cat {uris};; esac\n'
DPKG = '#!/bin/sh\nmkdir -p {work}/usr/share/doc {work}/usr/lib/__pycache__ && cp "$2" {work}/usr/lib/$(basename "$2").installed; cd {work} && tar -c ./usr\n'


@pytest.fixture(autouse=True)
def _nothing_resolved() -> None:
    """Other tests of this process have another apt."""
    debian._resolve.cache_clear()
    debian._fetch.cache_clear()


@pytest.fixture
def tools(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on PATH with the two; a log of what apt was asked; a cache with the three packages."""
    folder = tmp_path / "tools"
    folder.mkdir()
    (tmp_path / "uris").write_text(URIS)
    for name, text in (("apt-get", APT), ("dpkg-deb", DPKG)):
        (folder / name).write_text(text.format(log=tmp_path / "log", uris=tmp_path / "uris", work=tmp_path / "work"))
        (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "cache" / "robotapp" / "debian").mkdir(parents=True)
    for line in URIS.splitlines():
        (tmp_path / "cache" / "robotapp" / "debian" / line.split()[1]).write_text("content")
    return tmp_path


@pytest.mark.usefixtures("tools")
def test_the_closure_is_apts_answer_for_an_empty_system_without_what_only_installing_needs(tools: Path) -> None:
    assert [package.name for package in debian.closure(["python3-minimal"])] == ["libc6", "python3-minimal"]
    asked = (tools / "log").read_text()
    assert "Dir::State::status=/dev/null" in asked
    assert "--no-install-recommends" in asked


def test_packages_are_unpacked_into_a_merged_usr_without_documents_and_bytecode(tools: Path) -> None:
    layer = tools / "layer"
    layer.mkdir()
    debian.unpack(["python3-minimal"], layer)
    assert (layer / "lib").readlink() == Path("usr/lib")
    assert {path.name for path in (layer / "usr" / "lib").iterdir()} == {
        "libc6_2.36_amd64.deb.installed",
        "python3-minimal_3.11_amd64.deb.installed",
    }
    assert not (layer / "usr" / "share" / "doc").exists()


def test_what_a_lower_layer_has_is_left_out(tools: Path) -> None:
    layer = tools / "layer"
    layer.mkdir()
    debian.unpack(["python3-rospy"], layer, without=["python3-minimal"])
    assert list((layer / "usr" / "lib").iterdir()) == []


@pytest.mark.usefixtures("tools")
def test_a_package_that_cannot_be_had_is_said_with_the_advice() -> None:
    with pytest.raises(TestbedError, match=r"apt cannot get missing \(E: Unable to locate.*\): apt-get update"):
        debian.closure(["missing"])


def test_a_machine_without_apt_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(debian.shutil, "which", lambda _name: None)
    with pytest.raises(TestbedError, match="apt-get, dpkg-deb, tar is missing: build them on Debian or Ubuntu"):
        debian.closure(["python3-minimal"])
