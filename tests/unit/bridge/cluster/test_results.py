"""What is collected from an app, and what of a container's archive is taken."""

import io
import json
import tarfile
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from tests.unit.bridge.fake_cluster import FakeCluster, app

from rigel_bridge.cluster import results
from rigel_bridge.cluster.deployment import deploy
from rigel_bridge.cluster.results import ArchiveError, collect, files_of, newest, opened
from rigel_bridge.document.failures import BridgeError

READY = {"conditions": [{"type": "Ready", "status": "True"}]}


def pod(name: str, *, created: str = "2026-01-01", ready: bool = True, component: str = "driver") -> dict[str, Any]:
    labels = {"robotics.io/app-uid": "uid-teleop", "robotics.io/component": component, "robotics.io/instance": ""}
    metadata = {"name": name, "labels": labels, "creationTimestamp": created}
    return {"metadata": metadata, "spec": {"containers": [{"name": "driver"}]}, "status": READY if ready else {}}


def archive(**members: bytes) -> bytes:
    """Names with `/` are given with `__`."""
    target = io.BytesIO()
    with tarfile.open(fileobj=target, mode="w") as made:
        for name, content in members.items():
            info = tarfile.TarInfo(name.replace("__", "/"))
            info.size = len(content)
            made.addfile(info, io.BytesIO(content))
    return target.getvalue()


def running() -> tuple[FakeCluster, dict[str, Any]]:
    cluster = FakeCluster()
    stored = deploy(cluster, app(), tell=str).stored
    cluster.objects["pods", "p"] = pod("p")
    return cluster, stored


def test_state_logs_and_files_are_collected_with_their_checksums(tmp_path: Path) -> None:
    cluster, stored = running()
    cluster.contents = {("logs", "p"): b"hello", ("exec", "p"): archive(**{"out__rtt.csv": b"rtt_ms\n1\n"})}
    into = opened(tmp_path / "results")
    collect(cluster, stored, into, tell=pytest.fail, path="/results")
    into.close()
    sums = json.loads((into.folder / "manifest.json").read_text())["sha256"]
    assert set(sums) == {"app.json", "instances.json", "pods.json", "logs/p.driver.log", "files/driver/out/rtt.csv"}
    assert all(sha256((into.folder / name).read_bytes()).hexdigest() == digest for name, digest in sums.items())
    command = next(call for call in cluster.calls if call[0] == "exec")
    assert command[2:] == ("--", "tar", "-cf", "-", "-C", "/results", ".")


def test_what_cannot_be_had_is_told_and_left_out(tmp_path: Path) -> None:
    (cluster, stored), told = running(), list[str]()
    cluster.contents = {("exec", "p"): b"no archive" * 100}
    collect(cluster, stored, opened(tmp_path), tell=told.append, path="/results")
    assert [line.partition(":")[0] for line in told] == ["no log of p", "no result files of p from /results"]


def test_results_are_never_mixed(tmp_path: Path) -> None:
    (tmp_path / "old").touch()
    with pytest.raises(BridgeError, match="is not empty"):
        opened(tmp_path)
    with pytest.raises(BridgeError, match="cannot be written"):
        opened(tmp_path / "old" / "below a file")


def test_of_each_component_the_newest_ready_pod_is_asked() -> None:
    pods = [
        pod("old"),
        pod("new", created="2026-01-02"),
        pod("starting", created="2026-01-03", ready=False),
        pod("ui", component="ui"),
    ]
    assert {key: each["metadata"]["name"] for key, each in newest(pods).items()} == {"driver": "new", "ui": "ui"}


def test_an_archive_writes_nothing_outside_of_its_folder() -> None:
    target = io.BytesIO()
    with tarfile.open(fileobj=target, mode="w") as made:
        for name, kind, link in (
            ("../evil", tarfile.REGTYPE, ""),
            ("/etc/passwd", tarfile.REGTYPE, ""),
            ("link", tarfile.SYMTYPE, "/etc/passwd"),
            ("hard", tarfile.LNKTYPE, "../evil"),
            ("device", tarfile.CHRTYPE, ""),
            ("./a/good", tarfile.REGTYPE, ""),
        ):
            info = tarfile.TarInfo(name)
            info.type, info.linkname = kind, link
            made.addfile(info)
    assert [str(path) for path, _ in files_of(target.getvalue())] == ["a/good"]


def test_an_archive_that_is_cut_off_or_has_too_many_files_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "MAX_FILES", 3)
    with pytest.raises(ArchiveError, match="is no archive"):
        list(files_of(archive(a=b"x" * 5000)[:2000]))
    with pytest.raises(ArchiveError, match="more than 3 files"):
        list(files_of(archive(**{f"f{number}": b"" for number in range(4)})))


def header(name: str, *, kind: bytes = b"0", size: bytes = b"0" * 11 + b"\0") -> bytes:
    """One block of an archive, with fields that no honest program writes."""
    info = tarfile.TarInfo(name)
    info.type = kind
    block = bytearray(info.tobuf(tarfile.GNU_FORMAT))
    block[124:136] = size
    if kind == tarfile.GNUTYPE_SPARSE:  # one piece without content, in a file of 7 GiB
        block[386:410] = b"0" * 11 + b"\0" + b"0" * 11 + b"\0"
        block[483:495] = b"7" * 11 + b"\0"
    block[148:156] = b" " * 8
    block[148:156] = b"%06o\0 " % sum(block)
    return bytes(block)


LONG_NAME = header("././@LongLink", kind=tarfile.GNUTYPE_LONGNAME, size=b"%011o\0" % 2) + b"a\0".ljust(512, b"\0")


@pytest.mark.parametrize(
    "data",
    [
        header("sparse", kind=tarfile.GNUTYPE_SPARSE),
        header("x", size=b"\x80\x7f" + b"\xff" * 10),
        LONG_NAME * 2000 + header("x"),
    ],
    ids=["a file of 8 GiB in one block", "a size beyond any address", "headers without end"],
)
def test_an_archive_that_stands_for_more_than_it_holds_is_refused(data: bytes) -> None:
    with pytest.raises(ArchiveError, match="is no archive"):
        list(files_of(data + bytes(1024)))


def test_a_name_with_a_nul_is_passed_over() -> None:
    target = io.BytesIO()
    with tarfile.open(fileobj=target, mode="w", format=tarfile.PAX_FORMAT) as made:
        info = tarfile.TarInfo("x")
        info.pax_headers = {"path": "a\0b"}
        made.addfile(info)
        made.addfile(tarfile.TarInfo("good"))
    assert [str(path) for path, _ in files_of(target.getvalue())] == ["good"]


def test_names_that_no_file_can_have_leave_the_other_results(tmp_path: Path) -> None:
    (cluster, stored), told = running(), list[str]()
    names = {"a": b"1", "a__below": b"2", "x" * 300: b"3", "z.csv": b"4"}
    cluster.contents = {("logs", "p"): b"", ("exec", "p"): archive(**names)}
    into = opened(tmp_path / "results")
    collect(cluster, stored, into, tell=told.append, path="/results")
    assert {name for name in into.sums if name.startswith("files")} == {"files/driver/a", "files/driver/z.csv"}
    assert len(told) == 2
    assert all("is left out" in line and len(line) < 300 for line in told)
