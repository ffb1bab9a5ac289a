"""Reading of the host: bounded, within its root, skipping what fails, and cheap when nothing has changed."""

import os
from pathlib import Path

import pytest

from robotapp_agent.devices.tree import FOLDERS, Wanted
from robotapp_agent.shell.device_scanner import DeviceScanner, HostPaths
from robotapp_agent.shell.host.files import Bounds, Budget, Stopped, Tree
from robotapp_agent.shell.host.sysfs import SysfsReader
from robotapp_testbed.machines.fake_host import CAMERA, FakeHost, UsbModel


class Counted(Tree):
    """Counts the texts that are read."""

    reads = 0

    def content(self, path: str, name: str) -> str | None:
        Counted.reads += 1
        return super().content(path, name)


def tree(root: Path, *, bounds: Bounds = Bounds()) -> Tree:  # noqa: B008 - immutable
    return Tree(root, Budget(bounds, lambda: 0.0, lambda: False))


def test_no_link_is_followed_neither_at_the_end_nor_on_the_way(tmp_path: Path) -> None:
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret/name").write_text("password\n")
    root = tmp_path / "sys"
    (root / "class").mkdir(parents=True)
    (root / "class/name").symlink_to("../../secret/name")
    (root / "out").symlink_to("../secret")
    (root / "plain").write_text("fine\n")
    with tree(root) as files:
        assert files.text("", "plain") == "fine"
        assert files.text("class", "name") is None
        assert files.text("out", "name") is None
        assert files.names("out") == []
        assert files.text("..", "secret/name") is None
        assert files.text("class/..", "plain") is None


@pytest.mark.parametrize("target", ["/etc/passwd", "../../../../etc", "../../..", ""])
def test_a_link_that_leads_out_of_the_tree_leads_nowhere(tmp_path: Path, target: str) -> None:
    (tmp_path / "class/tty").mkdir(parents=True)
    if target:
        (tmp_path / "class/tty/ttyUSB0").symlink_to(target)
    with tree(tmp_path) as files:
        assert files.link("class/tty", "ttyUSB0") == ""


def test_pipes_and_device_files_are_never_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with tree(tmp_path) as files:
        assert files.text("", "pipe") is None  # opening it would wait for a writer
    with tree(Path("/dev")) as files:
        assert files.text("", "zero") is None


def test_a_long_text_is_cut_and_other_bytes_are_replaced(tmp_path: Path) -> None:
    (tmp_path / "long").write_text("x" * 100_000)
    (tmp_path / "odd").write_bytes(b"a\xff\x00b\n\x1b[31m")
    with tree(tmp_path) as files:
        assert files.text("", "long") == "x" * 256
        assert files.text("", "odd") == "a\N{REPLACEMENT CHARACTER} b \x1b[31m"


def test_more_than_a_scan_reads_ends_it(tmp_path: Path) -> None:
    for number in range(20):
        (tmp_path / f"f{number}").write_text("x")
    with tree(tmp_path, bounds=Bounds(entries=10)) as files, pytest.raises(Stopped, match="more than 10 entries"):
        files.names("")
    with tree(tmp_path, bounds=Bounds(files=10)) as files, pytest.raises(Stopped, match="more files"):
        [files.text("", f"f{number}") for number in range(20)]
    with tree(tmp_path, bounds=Bounds(total_bytes=3)) as files, pytest.raises(Stopped, match="more files"):
        [files.text("", f"f{number}") for number in range(20)]


def test_a_scan_that_meets_a_bound_or_is_ended_unplugs_nothing(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2")
    cancelled = False
    moment = 0.0
    scanner = DeviceScanner(HostPaths.below(tmp_path), clock=lambda: moment, cancelled=lambda: cancelled)
    before = scanner.scan().devices
    assert len(before) == 1
    cancelled = True
    scan = scanner.scan()
    assert scan.devices == before
    assert "the agent ends" in scan.problem
    cancelled = False
    (tmp_path / "sys").rename(tmp_path / "elsewhere")
    scan = scanner.scan()
    assert scan.devices == before
    assert "not there" in scan.problem


def test_slow_files_end_a_scan(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2")
    clock = iter(range(0, 100_000, 2))
    snapshot = SysfsReader(HostPaths.below(tmp_path), clock=lambda: float(next(clock))).read(Wanted())
    assert "took more than 5 s" in snapshot.problem


def test_a_second_scan_reads_no_attribute_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robotapp_agent.shell.host.sysfs.Tree", Counted)
    host = FakeHost(tmp_path)
    host.camera("1-2")
    for number in range(50):
        host.network(f"veth{number}")
    (tmp_path / "run/udev/data").rmdir()
    reader = SysfsReader(HostPaths.below(tmp_path))
    first = reader.read(Wanted())
    Counted.reads = 0
    assert reader.read(Wanted()) == first
    assert Counted.reads == 0


def test_a_device_that_was_replaced_between_two_scans_is_read_anew(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    usb = host.camera("1-2", UsbModel("046d", "082d", "C920", serial="5F1A33BF"))
    scanner = DeviceScanner(HostPaths.below(tmp_path))
    assert [device.id for device in scanner.scan().devices] == ["video-046d-082d-5f1a33bf"]
    host.remove(usb)
    host.camera("1-2", UsbModel("8086", "0b3a", "D435i", serial="0123X"))
    scanner.scan()
    present = {device.id for device in scanner.scan().devices if device.present}
    assert present == {"video-8086-0b3a-0123x"}


def test_every_folder_that_is_read_may_be_missing_or_a_file(tmp_path: Path) -> None:
    for number, folder in enumerate(FOLDERS):
        root = tmp_path / str(number)
        host = FakeHost(root)
        host.camera("1-2", CAMERA)
        place = root / "sys" / folder.path
        if place.is_dir():
            for link in place.iterdir():
                link.unlink()
            place.rmdir()
        else:
            place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text("no folder")
        assert DeviceScanner(HostPaths.below(root)).scan().problem == ""
