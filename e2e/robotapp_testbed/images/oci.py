"""Writes an OCI image archive from folders, and unpacks one: the same content gives the same bytes, whoever builds it and when.

Format: OCI image layout 1.0 in a tar, uncompressed layers, the name as containerd's import reads it.
"""

import hashlib
import io
import json
import tarfile
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from robotapp_testbed.failures import TestbedError

_CHUNK_BYTES = 1 << 20
_TYPES = "application/vnd.oci.image"


@dataclass(frozen=True, slots=True)
class Config:
    """What a container of the image starts as. `user` is numeric, so that runAsNonRoot can be verified."""

    entrypoint: Sequence[str]
    architecture: str
    user: str = "65532:65532"
    env: Mapping[str, str] | None = None
    working_dir: str = "/"


@dataclass(frozen=True, slots=True)
class _Blob:
    file: IO[bytes]
    digest: str
    size: int

    def descriptor(self, kind: str) -> dict[str, Any]:
        return {"mediaType": f"{_TYPES}.{kind}", "digest": f"sha256:{self.digest}", "size": self.size}


def write(target: Path, name: str, folders: Sequence[Path], config: Config) -> None:
    """One layer per folder, the first one lowest. Owner is root, times are 0, modes are 0644 or 0755 (sticky bit kept)."""
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".layers-") as scratch:
        layers = [_layer(folder, Path(scratch, str(at))) for at, folder in enumerate(folders)]
        try:
            _write_layout(target, name, layers, _config(config, layers))
        finally:
            for layer in layers:
                layer.file.close()


def unpack(archive: Path, target: Path) -> None:
    """Makes the root file system of an archive written here in the folder `target`, lowest layer first."""
    with tarfile.open(archive) as image:
        (named,) = _document(image, "index.json")["manifests"]
        for layer in _document(image, _blob_path(named["digest"]))["layers"]:
            with tarfile.open(fileobj=image.extractfile(_blob_path(layer["digest"]))) as files:
                # Python 3.11.2 (Debian 12) has no filters yet, newer ones would refuse devices and setuid alone.
                files.extraction_filter = getattr(tarfile, "tar_filter", None)
                files.extractall(target)  # noqa: S202 - written by this module


def _document(image: tarfile.TarFile, path: str) -> dict[str, Any]:
    file = image.extractfile(path)
    if file is None:
        raise TestbedError(f"{path} of the image is no file: remove {image.name!r} and try again")
    document: dict[str, Any] = json.load(file)
    return document


def _blob_path(digest: str) -> str:
    return f"blobs/{digest.replace(':', '/')}"


def _layer(folder: Path, scratch: Path) -> _Blob:
    with tarfile.open(scratch, mode="w", format=tarfile.GNU_FORMAT) as tar:
        for path in _tree(folder):
            tar.add(path, str(path.relative_to(folder)), recursive=False, filter=_anonymous)
    return _blob(scratch.open("rb"))


def _tree(folder: Path) -> Iterator[Path]:
    """Everything below, folders before what is in them, in the order of names."""
    for path in sorted(folder.iterdir()):
        yield path
        if path.is_dir() and not path.is_symlink():
            yield from _tree(path)


def _anonymous(member: tarfile.TarInfo) -> tarfile.TarInfo:
    member.uid = member.gid = 0
    member.uname = member.gname = ""
    member.mtime = 0
    # The builder's umask is not content.
    executable = member.isdir() or member.issym() or member.mode & 0o100
    member.mode = (member.mode & 0o1000) | (0o777 if member.mode & 0o002 else 0o755 if executable else 0o644)
    return member


def _config(config: Config, layers: Sequence[_Blob]) -> _Blob:
    settings = {
        "Entrypoint": list(config.entrypoint),
        "Env": [f"{name}={value}" for name, value in sorted((config.env or {}).items())],
        "User": config.user,
        "WorkingDir": config.working_dir,
    }
    return _json_blob(
        {
            "architecture": config.architecture,
            "os": "linux",
            "config": settings,
            "rootfs": {"type": "layers", "diff_ids": [f"sha256:{layer.digest}" for layer in layers]},
            "history": [{"created_by": "robotapp_testbed.images"} for _ in layers],
        }
    )


def _write_layout(target: Path, name: str, layers: Sequence[_Blob], config: _Blob) -> None:
    manifest = _json_blob(
        {
            "schemaVersion": 2,
            "mediaType": f"{_TYPES}.manifest.v1+json",
            "config": config.descriptor("config.v1+json"),
            "layers": [layer.descriptor("layer.v1.tar") for layer in layers],
        }
    )
    named = {"io.containerd.image.name": name, "org.opencontainers.image.ref.name": name.rpartition(":")[2]}
    index = {"schemaVersion": 2, "manifests": [{**manifest.descriptor("manifest.v1+json"), "annotations": named}]}
    with tarfile.open(target, mode="w", format=tarfile.GNU_FORMAT) as tar:
        _add(tar, "oci-layout", _json_blob({"imageLayoutVersion": "1.0.0"}))
        _add(tar, "index.json", _json_blob(index))
        for blob in {blob.digest: blob for blob in (manifest, config, *layers)}.values():
            _add(tar, f"blobs/sha256/{blob.digest}", blob)


def _json_blob(tree: object) -> _Blob:
    return _blob(io.BytesIO(json.dumps(tree, sort_keys=True, separators=(",", ":")).encode()))


def _blob(file: IO[bytes]) -> _Blob:
    digest, size = hashlib.sha256(), 0
    while chunk := file.read(_CHUNK_BYTES):
        digest.update(chunk)
        size += len(chunk)
    return _Blob(file=file, digest=digest.hexdigest(), size=size)


def _add(tar: tarfile.TarFile, name: str, blob: _Blob) -> None:
    member = tarfile.TarInfo(name)
    member.size = blob.size
    blob.file.seek(0)
    tar.addfile(member, blob.file)
