"""Downloads against a local stand-in: right, wrong, slow and absent sources."""

import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from e2e.tests.testbed.release_server import ReleaseServer, serving
from tests.support.work_unit import is_in_time

from robotapp_testbed.binaries import pins, release
from robotapp_testbed.binaries.release import Downloader, ReleaseProblem

ETCD, KUBECTL, HELM, KWOK = (pins.binary(name) for name in ("etcd", "kubectl", "helm", "kwok"))


@pytest.fixture
def server() -> Iterator[ReleaseServer]:
    with serving() as running:
        yield running


def closed_url() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"http://127.0.0.1:{probe.getsockname()[1]}"


@pytest.mark.parametrize("binary", [ETCD, KUBECTL, HELM], ids=lambda binary: binary.name)
def test_a_verified_binary_is_written(binary: pins.Binary, server: ReleaseServer, tmp_path: Path) -> None:
    server.publish(binary, b"the program")
    notes: list[str] = []
    Downloader(server.base_urls()).fetch(binary, tmp_path / "target", note=notes.append)
    assert (tmp_path / "target").read_bytes() == b"the program"
    assert [path.name for path in tmp_path.iterdir()] == ["target"]
    assert notes[-1].endswith(" MB")


@pytest.mark.parametrize("binary", [ETCD, KUBECTL, HELM], ids=lambda binary: binary.name)
def test_a_wrong_checksum_leaves_no_file(binary: pins.Binary, server: ReleaseServer, tmp_path: Path) -> None:
    server.publish(binary, b"tampered", digest="1" * 64)
    with pytest.raises(ReleaseProblem, match="does not match its published checksum"):
        Downloader(server.base_urls()).fetch(binary, tmp_path / "target")
    assert list(tmp_path.iterdir()) == []


def test_a_binary_without_a_checksum_file_is_not_downloaded(server: ReleaseServer, tmp_path: Path) -> None:
    server.files[f"/{KUBECTL.release.file.format(**pins.platform_names())}"] = b"unverifiable"  # type: ignore[union-attr]  # kubectl has one
    with pytest.raises(ReleaseProblem, match="Not Found"):
        Downloader(server.base_urls()).fetch(KUBECTL, tmp_path / "target")
    assert len(server.requests) == 1, "only the checksum was asked for"


def test_a_checksum_file_for_other_files_is_refused(server: ReleaseServer, tmp_path: Path) -> None:
    server.publish(HELM, b"helm")
    checksums = next(path for path in server.files if path.endswith(".sha256sum"))
    server.files[checksums] = f"{'0' * 64}  something-else.tar.gz\n".encode()
    with pytest.raises(ReleaseProblem, match="does not mention helm-"):
        Downloader(server.base_urls()).fetch(HELM, tmp_path / "target")


def test_a_source_that_cannot_be_reached_is_given_up_in_a_moment(tmp_path: Path) -> None:
    downloader = Downloader({**dict.fromkeys(pins.BASE_URLS, "http://127.0.0.1:9"), "kubernetes": closed_url()})
    started = time.monotonic()
    with pytest.raises(ReleaseProblem, match=r"no usable answer from http://127.0.0.1:"):
        downloader.fetch(KUBECTL, tmp_path / "target")
    assert is_in_time(time.monotonic() - started, 2)
    assert not downloader.offers(KUBECTL)
    assert downloader.offers(ETCD), "other sources may still answer"


def test_a_download_slower_than_compiling_is_given_up(server: ReleaseServer, tmp_path: Path) -> None:
    server.publish(KUBECTL, b"x" * 100_000)
    server.trickle_s = {path: 0.0005 for path in server.files if path.endswith("/kubectl")}
    arriving = tmp_path / "target.download"
    downloader = Downloader(server.base_urls(), clock=lambda: 3600.0 if arriving.exists() else 0.0)
    started = time.monotonic()
    with pytest.raises(ReleaseProblem, match="slower than compiling"):
        downloader.fetch(KUBECTL, tmp_path / "target")
    assert is_in_time(time.monotonic() - started, 10)
    assert list(tmp_path.iterdir()) == []


def test_a_binary_without_an_official_checksum_is_never_offered() -> None:
    assert not Downloader(release.base_urls({})).offers(KWOK)
    with pytest.raises(ReleaseProblem, match="no verifiable official release"):
        Downloader(release.base_urls({})).fetch(KWOK, Path("unused"))


def test_base_urls_are_overridden_one_by_one_and_empty_means_never() -> None:
    urls = release.base_urls({"ROBOTAPP_RELEASES_HELM": "", "ROBOTAPP_RELEASES_ETCD": "http://mirror/etcd"})
    assert urls == {**pins.BASE_URLS, "helm": "", "etcd": "http://mirror/etcd"}
    assert not Downloader(urls).offers(HELM)
