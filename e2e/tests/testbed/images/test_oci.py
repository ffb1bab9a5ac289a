"""The archive writer: a valid OCI layout, and the same bytes from the same content."""

import hashlib
import json
import os
import tarfile
from pathlib import Path
from typing import Any

import pytest

from robotapp_testbed.images import oci

CONFIG = oci.Config(entrypoint=["/bin/app", "-v"], architecture="amd64", env={"B": "2", "A": "1"})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "content"
    (made / "bin").mkdir(parents=True)
    (made / "bin" / "app").write_text("program")
    (made / "bin" / "app").chmod(0o750)
    (made / "data").write_text("data")
    (made / "data").chmod(0o600)
    (made / "link").symlink_to("bin")
    (made / "tmp").mkdir()
    (made / "tmp").chmod(0o1777)
    return made


def contents(archive: Path) -> dict[str, bytes]:
    with tarfile.open(archive) as tar:
        return {member.name: tar.extractfile(member).read() for member in tar}  # type: ignore[union-attr] # all are files


def parsed(archive: Path) -> tuple[dict[str, Any], dict[str, Any], list[bytes]]:
    """Index entry, configuration, layers; every digest and size is checked."""
    files = contents(archive)
    for name, content in files.items():
        if name.startswith("blobs/"):
            assert name == f"blobs/sha256/{hashlib.sha256(content).hexdigest()}"

    def follow(descriptor: dict[str, Any]) -> bytes:
        content = files[f"blobs/sha256/{descriptor['digest'].removeprefix('sha256:')}"]
        assert len(content) == descriptor["size"]
        return content

    (entry,) = json.loads(files["index.json"])["manifests"]
    manifest = json.loads(follow(entry))
    return entry, json.loads(follow(manifest["config"])), [follow(layer) for layer in manifest["layers"]]


def test_the_archive_is_a_named_oci_layout(folder: Path, tmp_path: Path) -> None:
    oci.write(tmp_path / "a.tar", "localhost/thing:one", [folder], CONFIG)
    entry, config, layers = parsed(tmp_path / "a.tar")
    assert entry["annotations"]["io.containerd.image.name"] == "localhost/thing:one"
    assert entry["annotations"]["org.opencontainers.image.ref.name"] == "one"
    assert config["config"] == {
        "Entrypoint": ["/bin/app", "-v"],
        "Env": ["A=1", "B=2"],
        "User": "65532:65532",
        "WorkingDir": "/",
    }
    assert config["rootfs"]["diff_ids"] == [f"sha256:{hashlib.sha256(layers[0]).hexdigest()}"]
    assert json.loads(contents(tmp_path / "a.tar")["oci-layout"]) == {"imageLayoutVersion": "1.0.0"}


def test_members_belong_to_root_with_plain_modes_and_no_times(folder: Path, tmp_path: Path) -> None:
    oci.write(tmp_path / "a.tar", "n:t", [folder], CONFIG)
    (tmp_path / "layer.tar").write_bytes(parsed(tmp_path / "a.tar")[2][0])
    with tarfile.open(tmp_path / "layer.tar") as tar:
        members = tar.getmembers()
    assert {(member.uid, member.gid, member.uname, member.mtime) for member in members} == {(0, 0, "", 0)}
    assert {member.name: member.mode for member in members if not member.issym()} == {
        "bin": 0o755,
        "bin/app": 0o755,
        "data": 0o644,
        "tmp": 0o1777,
    }


def test_times_owners_and_the_order_of_creation_do_not_matter(folder: Path, tmp_path: Path) -> None:
    oci.write(tmp_path / "a.tar", "n:t", [folder], CONFIG)
    other = tmp_path / "other"
    (other / "tmp").mkdir(parents=True)
    (other / "tmp").chmod(0o1777)
    (other / "link").symlink_to("bin")
    (other / "data").write_text("data")
    (other / "bin").mkdir()
    (other / "bin" / "app").write_text("program")
    (other / "bin" / "app").chmod(0o700)
    os.utime(other / "data", (1, 1))
    oci.write(tmp_path / "b.tar", "n:t", [other], CONFIG)
    assert (tmp_path / "a.tar").read_bytes() == (tmp_path / "b.tar").read_bytes()


def test_layers_keep_their_order(folder: Path, tmp_path: Path) -> None:
    upper = tmp_path / "upper"
    upper.mkdir()
    (upper / "over").write_text("upper")
    oci.write(tmp_path / "a.tar", "n:t", [folder, upper], CONFIG)
    _, config, layers = parsed(tmp_path / "a.tar")
    assert b"upper" in layers[1]
    assert config["rootfs"]["diff_ids"] == [f"sha256:{hashlib.sha256(layer).hexdigest()}" for layer in layers]
    assert {path.name for path in tmp_path.iterdir()} == {"content", "upper", "a.tar"}
