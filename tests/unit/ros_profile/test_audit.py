"""The whole generator over a hostile package: audit events show that it only reads, and only within the package."""

import subprocess
import sys
import time
from pathlib import Path

from campaigns.profile.profile_hostile import SECRET, Hostile, everything, seconds, watched
from ros_profile.generate import generate_profile

SAMPLE = 40
"""Damaged packages tried each time; `scripts/bench profile_hostile` tries 2,000."""


def test_a_package_that_points_everywhere_is_read_within_its_folder_only(tmp_path: Path) -> None:
    hostile = Hostile.made(tmp_path)
    (package,) = generate_profile(hostile.folder).packages  # once, so that nothing is imported later
    assert {"run", "a", "B"} <= {executable.name for executable in package.executables}
    assert {"launch/a.launch.py", "launch/b.launch"} <= {launch.file for launch in package.launches}
    everything(hostile.folder)
    assert hostile.problems() == []
    assert not (tmp_path / "outside/pwned").exists()


def test_damaged_packages_are_read_within_their_folder_in_the_time_of_a_whole_one(tmp_path: Path) -> None:
    hostile = Hostile.made(tmp_path)
    everything(hostile.folder)
    usual = min(seconds(hostile) for _ in range(3))
    day = int(time.time()) // 86_400
    for seed in range(day * SAMPLE, (day + 1) * SAMPLE):
        with hostile.damaged(seed) as names:
            assert hostile.problems() == [], f"seed {seed}: {names}"
            assert seconds(hostile) < 10 * usual + 0.5, f"seed {seed}: {names}"


def test_a_manifest_that_is_a_link_out_of_the_folder_is_no_package(tmp_path: Path) -> None:
    hostile = Hostile.made(tmp_path)
    (hostile.folder / "package.xml").unlink()
    (hostile.folder / "package.xml").symlink_to("../outside/package.xml")
    everything(hostile.folder)
    with watched(hostile.folder) as watch:
        written = everything(hostile.folder)
    assert watch.found == []
    assert SECRET not in written


def test_the_watch_sees_what_it_is_there_for(tmp_path: Path) -> None:
    outside = Hostile.made(tmp_path).folder.parent / "outside"
    with watched(tmp_path / "thing") as watch:
        (outside / "evil.py").read_text()
        list(outside.iterdir())
        (tmp_path / "thing/new").write_text("")
        subprocess.run([sys.executable, "-c", ""], check=True)
    kinds = {event.partition(" ")[0] for event in watch.found}
    assert {"open", "os.listdir", "subprocess.Popen"} <= kinds
    assert f"open {tmp_path}/thing/new" in watch.found
