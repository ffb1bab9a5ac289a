"""Files of the node: whole or not at all, and device files found behind links."""

import os
import pty
from pathlib import Path

import pytest
from tests.support.agent.dra import HostRoot, prepared

from robotapp_agent.driver.node_files import (
    CdiFolder,
    Checkpoint,
    CheckpointError,
    DeviceFiles,
    read_boot_id,
    write_file,
)
from robotapp_agent.driver.rules.cdi_spec import DeviceFile
from robotapp_agent.driver.rules.ledger import Ledger


def test_a_ledger_is_read_as_it_was_written(tmp_path: Path) -> None:
    checkpoint = Checkpoint(tmp_path / "new")
    assert checkpoint.load() == Ledger()
    ledger = Ledger(claims={"uid-of-driver": prepared()})
    checkpoint.save(ledger)
    assert checkpoint.load() == ledger
    assert checkpoint.path.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    "content", ["", '{"version": 1, "claims": ', '{"version": 2}', '{"version": 1, "claims": {"a": 1}}']
)
def test_a_checkpoint_that_cannot_be_used_stops_the_driver_with_the_cure(tmp_path: Path, content: str) -> None:
    checkpoint = Checkpoint(tmp_path)
    checkpoint.path.write_text(content)
    with pytest.raises(CheckpointError, match="Remove it when no pod"):
        checkpoint.load()


def test_a_write_that_fails_leaves_the_file_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    write_file(path, b"old")

    def fail(_: int) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="no space"):
        write_file(path, b"new")
    assert path.read_bytes() == b"old"


def test_what_a_killed_writer_left_is_in_nobodys_way(tmp_path: Path) -> None:
    (tmp_path / ".file.draft").write_text("half a fi")
    write_file(tmp_path / "file", b"whole")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_spec_is_written_only_when_it_changes(tmp_path: Path) -> None:
    folder = CdiFolder(tmp_path / "cdi")
    assert folder.write("uid", {"kind": "k"})
    assert not folder.write("uid", {"kind": "k"})
    assert folder.write("uid", {"kind": "l"})
    assert folder.list_uids() == ["uid"]
    folder.remove("uid")
    folder.remove("uid")
    assert folder.list_uids() == []


def test_a_device_file_is_found_behind_links_of_the_host(tmp_path: Path) -> None:
    """A link on the host names paths of the host: below our mount they are elsewhere."""
    host = HostRoot(tmp_path)
    ours, theirs = pty.openpty()
    try:
        terminal = os.ttyname(theirs)
        host.link("/dev/pts", "/dev/pts")
        host.link("/dev/ttyUSB0", terminal)
        host.link("/dev/lidar", "ttyUSB0")
        state = Path(terminal).stat()
        assert DeviceFiles(Path("/")).find(terminal) == DeviceFile(
            terminal, terminal=True, gid=state.st_gid, number=state.st_rdev
        )
        assert DeviceFiles(tmp_path).find("/dev/missing") is None
    finally:
        os.close(ours)
        os.close(theirs)


def test_a_link_to_itself_and_a_plain_file_are_no_devices(tmp_path: Path) -> None:
    host = HostRoot(tmp_path)
    host.link("/dev/loop", "/dev/loop")
    (tmp_path / "dev/plain").write_text("no device")
    files = DeviceFiles(tmp_path)
    assert files.find("/dev/loop") is None
    assert files.find("/dev/plain") is None
    assert files.list_sound() == []


def test_a_character_device_is_no_terminal() -> None:
    assert DeviceFiles(Path("/")).find("/dev/null") == DeviceFile("/dev/null", gid=0)


def test_the_boot_has_an_id() -> None:
    assert len(read_boot_id()) == 36
