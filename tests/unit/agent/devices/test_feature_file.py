"""The feature file as the worker of Node Feature Discovery reads it."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from robotapp_agent.devices.device import Device
from robotapp_agent.devices.labels import labels_of
from robotapp_agent.shell.feature_file import EXPIRES_AFTER, FeatureFile

CAMERA = Device(id="video-a", type="video", model="C920", names=("sensor-usb-cam",))
BUS = Device(id="can-can0", type="can", interface="can0")


class Clock:
    def __init__(self) -> None:
        self.now = datetime(2026, 11, 22, 12, tzinfo=UTC)

    def __call__(self) -> datetime:
        return self.now


def as_nfd_reads(folder: Path, now: datetime) -> dict[str, str]:
    """By NFD's rules: no dot files, at most 64 KiB, `key[=value]` lines, `# +expiry-time` for the lines after it."""
    labels = {}
    for path in folder.iterdir():
        if path.name.startswith(".") or path.stat().st_size > 65_536:
            continue
        expires = now
        for line in map(str.strip, path.read_text().split("\n")):
            if line.startswith("# +"):
                directive, _, value = line.removeprefix("# +").partition("=")
                assert directive == "expiry-time"
                expires = datetime.fromisoformat(value)
            elif line and not line.startswith("#") and expires >= now:
                key, equals, value = line.partition("=")
                labels[key] = value if equals else "true"
    return labels


def test_nfd_reads_the_labels_of_the_devices(tmp_path: Path) -> None:
    clock = Clock()
    file = FeatureFile(tmp_path, now=clock)
    assert file.write([CAMERA, BUS])
    assert as_nfd_reads(tmp_path, clock.now) == labels_of([CAMERA, BUS])
    assert [path.name for path in tmp_path.iterdir()] == ["robotapp"]


def test_the_file_is_written_only_when_labels_change_or_expire_soon(tmp_path: Path) -> None:
    clock = Clock()
    file = FeatureFile(tmp_path, now=clock)
    file.write([CAMERA])
    assert not file.write([CAMERA])
    clock.now += EXPIRES_AFTER / 2
    assert file.write([CAMERA])
    assert not file.write([CAMERA])
    assert file.write([CAMERA, BUS])
    clock.now += EXPIRES_AFTER - timedelta(seconds=1)
    assert as_nfd_reads(tmp_path, clock.now)
    clock.now += timedelta(seconds=2)
    assert as_nfd_reads(tmp_path, clock.now) == {}  # the agent is gone


@pytest.mark.parametrize("jump", [timedelta(days=1), -timedelta(days=1), -timedelta(minutes=10)])
def test_after_a_jump_of_the_clock_the_labels_are_read_again(tmp_path: Path, jump: timedelta) -> None:
    clock = Clock()
    file = FeatureFile(tmp_path, now=clock)
    file.write([CAMERA])
    clock.now += jump
    assert file.write([CAMERA])
    assert as_nfd_reads(tmp_path, clock.now) == labels_of([CAMERA])


def test_a_file_that_somebody_removed_is_written_again(tmp_path: Path) -> None:
    file = FeatureFile(tmp_path, now=Clock())
    file.write([CAMERA])
    (tmp_path / "robotapp").unlink()
    assert file.write([CAMERA])


def test_without_nfd_nothing_is_written_and_when_it_comes_the_file_is(tmp_path: Path) -> None:
    folder = tmp_path / "features.d"
    file = FeatureFile(folder, now=Clock())
    assert not file.write([CAMERA])
    assert file.problem == ""
    assert list(tmp_path.iterdir()) == []
    folder.mkdir()
    assert file.write([CAMERA])


def test_a_draft_that_another_program_left_or_planted_is_no_way_out_of_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "features.d"
    folder.mkdir()
    (tmp_path / "victim").write_text("untouched")
    (folder / ".robotapp").symlink_to("../victim")
    (folder / "robotapp").symlink_to("../victim")
    assert FeatureFile(folder, now=Clock()).write([CAMERA])
    assert (tmp_path / "victim").read_text() == "untouched"


def test_an_error_is_kept_for_the_log(tmp_path: Path) -> None:
    (tmp_path / "robotapp").mkdir()
    file = FeatureFile(tmp_path, now=Clock())
    assert not file.write([CAMERA])
    assert "cannot be written" in file.problem
