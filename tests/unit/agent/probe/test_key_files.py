"""The folder as a kubelet mounts it: files are links through `..data` into a folder with the time in its name."""

import os
from pathlib import Path

from robotapp_agent.probe.keys import KeyRing, key_of
from robotapp_agent.shell.key_files import refresh_keys

OLD, NEW = b"o" * 32, b"n" * 32


def mount(folder: Path, version: str, **files: bytes) -> None:
    """As the kubelet does it: a new folder, then one rename."""
    content = folder / f"..{version}"
    content.mkdir(parents=True)
    for name, secret in files.items():
        (content / name).write_bytes(secret)
        if not (folder / name).is_symlink():
            (folder / name).symlink_to(f"..data/{name}")
    (folder / "..data_tmp").symlink_to(content.name)
    (folder / "..data_tmp").rename(folder / "..data")
    for path in folder.iterdir():
        if not path.name.startswith("..") and not path.exists():
            path.unlink()


def test_files_of_a_mounted_secret_are_keys_and_a_change_is_seen(tmp_path: Path) -> None:
    ring = KeyRing()
    mount(tmp_path, "2026_11_22", old=OLD)
    assert refresh_keys(ring, tmp_path, now_s=0) == ()
    assert ring.signing == key_of(OLD)
    mount(tmp_path, "2026_11_23", new=NEW)
    assert refresh_keys(ring, tmp_path, now_s=1000) == ()
    assert ring.find(key_of(NEW).id)
    assert refresh_keys(ring, tmp_path, now_s=2000) == ()
    assert ring.signing == key_of(NEW)


def test_a_folder_that_is_not_there_leaves_the_ring_as_it_is(tmp_path: Path) -> None:
    ring = KeyRing()
    mount(tmp_path, "1", old=OLD)
    refresh_keys(ring, tmp_path, now_s=0)
    (problem,) = refresh_keys(ring, tmp_path / "missing", now_s=5000)
    assert problem.startswith("the folder of the probe keys cannot be read")
    assert ring.signing == key_of(OLD)


def test_what_is_no_file_is_no_key_and_a_huge_file_is_not_read_whole(tmp_path: Path) -> None:
    ring = KeyRing()
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "huge").write_bytes(bytes(1_000_000))
    (tmp_path / "key").write_bytes(OLD)
    (problem,) = refresh_keys(ring, tmp_path, now_s=0)
    assert problem.startswith("probe key huge has 1025 bytes")
    assert ring.signing == key_of(OLD)
