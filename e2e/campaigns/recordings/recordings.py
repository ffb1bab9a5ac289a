"""Measures the loss of a killed recorder, and its disk. Real rclpy: a talker, and the recorder killed at random moments, again and again.

After each kill every closed bag must open, the one that was open is completed by the next start, no more than the open chunk is lost, and
all files together never exceed the bound by more than a split. No cluster and no containers: both are processes of this machine.
"""

import argparse
import os
import random
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from rosbags.rosbag2 import Reader

from campaigns.common import options
from campaigns.common.output import save, say
from robotapp_recorder.store import CLOSED, OPEN
from robotapp_testbed.binaries import pins
from robotapp_testbed.images import wheels
from robotapp_testbed.images.pythonic import Ros2Jazzy

TOPIC: Final = "/recorded"
PERIOD_S: Final = 0.01
MESSAGE_BYTES: Final = 4096
SPLIT_BYTES: Final = 1 << 20
RETAIN_BYTES: Final = 4 << 20
CHUNK_BYTES: Final = SPLIT_BYTES // 4
UNDER_WAY: Final = 20
"""Messages that were sent and not yet received when the recorder was killed, and those sent until the kill had an effect: 0.2 s."""
LONGEST_LIFE_S: Final = 4.0
STARTED_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class Life:
    """One life of the recorder. lost: messages sent before its end that are in no bag. gaps: numbers that are missing before its last one."""

    seconds: float
    kept: int
    lost: int
    gaps: int


@dataclass(frozen=True, slots=True)
class Result:
    """Figures that `--json` writes. excess_bytes: by how much all files together exceeded the bound at worst, sampled; 0 if never."""

    kills: int
    kept: int
    most_lost: int
    allowed: int
    gaps: int
    opened_bags: int
    excess_bytes: int
    split_bytes: int
    problems: list[str]


class DiskUse(threading.Thread):
    """Samples what the files of a folder take, as often as it can."""

    def __init__(self, folder: Path) -> None:
        super().__init__(daemon=True)
        self._folder = folder
        self._over = threading.Event()
        self.most_bytes = 0

    def run(self) -> None:
        while not self._over.wait(0.005):
            self.most_bytes = max(self.most_bytes, sum(map(_size, self._folder.glob("*"))))

    def end(self) -> None:
        self._over.set()
        self.join()


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:  # deleted or renamed meanwhile
        return 0


class Lines(threading.Thread):
    """Keeps the last line of a program's output."""

    def __init__(self, program: subprocess.Popen[str]) -> None:
        super().__init__(daemon=True)
        self._program = program
        self.last = ""

    def run(self) -> None:
        for line in self._program.stdout or ():
            self.last = line.strip()


def environment(home: Path) -> Mapping[str, str]:
    """The variables with which a process of this machine finds ROS 2 below `home`, in a domain of its own."""
    libraries = ":".join(str(path) for path in (home / "lib", *sorted(home.glob("*.libs"))))
    places = (
        home / "lib" / "python3.11" / "site-packages",
        home,
        pins.REPOSITORY / "e2e",
        pins.REPOSITORY / "recorder",
    )
    return {
        **os.environ,
        "AMENT_PREFIX_PATH": str(home),
        "LD_LIBRARY_PATH": libraries,
        "PYTHONPATH": ":".join(map(str, places)),
        "ROS_VERSION": "2",
        "ROS_DISTRO": "jazzy",
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
        "ROS_DOMAIN_ID": str(random.randint(50, 90)),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PYTHONUNBUFFERED": "1",
    }


@contextmanager
def talking(variables: Mapping[str, str]) -> Iterator[Lines]:
    """Runs the talker."""
    words = ["-m", "campaigns.recordings.talker", TOPIC, str(PERIOD_S), str(MESSAGE_BYTES)]
    program = subprocess.Popen([sys.executable, *words], env=variables, stdout=subprocess.PIPE, text=True)
    lines = Lines(program)
    lines.start()
    try:
        yield lines
    finally:
        program.kill()
        program.wait()


def start_recorder(folder: Path, variables: Mapping[str, str]) -> subprocess.Popen[bytes]:
    """Starts the recorder as its component does."""
    words = ["-m", "robotapp_recorder", "record", "--folder", str(folder), "--name", "run", "--topic", TOPIC]
    words += ["--split-bytes", str(SPLIT_BYTES), "--retain-bytes", str(RETAIN_BYTES)]
    with (folder.parent / "recorder.log").open("ab") as log:
        return subprocess.Popen([sys.executable, *words], env=variables, stdout=log, stderr=log)


def await_data(folder: Path, program: subprocess.Popen[bytes]) -> None:
    """Waits until the open bag of this recorder has messages: more than its head."""
    end_s = time.monotonic() + STARTED_S
    while not any(_size(path) > CHUNK_BYTES // 2 for path in folder.glob(f"*{OPEN}")):
        if program.poll() is not None or time.monotonic() > end_s:
            log = (folder.parent / "recorder.log").read_text()[-2000:]
            raise SystemExit(f"the recorder recorded nothing in {STARTED_S:g} s:\n{log}")
        time.sleep(0.02)


def read_numbers(path: Path) -> list[int]:
    """The numbers in a closed bag, by a reader that is not the recorder's."""
    with Reader(path) as reader:
        return [int(bytes(data[8:40]).split(b":")[0]) for _, _, data in reader.messages()]


def live_once(folder: Path, variables: Mapping[str, str], lines: Lines) -> tuple[float, int]:
    """Runs the recorder for a random time and kills it. Returns the time, and the last number that was sent by then."""
    program = start_recorder(folder, variables)
    await_data(folder, program)
    began_s = time.monotonic()
    time.sleep(random.uniform(0.0, LONGEST_LIFE_S))
    sent = int(lines.last)
    program.kill()
    program.wait()
    return time.monotonic() - began_s, sent


def complete(folder: Path, variables: Mapping[str, str]) -> None:
    """Completes the bag of the killed recorder by a start that records nothing: its topic does not exist."""
    words = ["-c", "import sys; from pathlib import Path; from robotapp_recorder.store import BagStore, Limits; "]
    words[1] += f"BagStore(Path(sys.argv[1]), 'run', Limits({SPLIT_BYTES}, {RETAIN_BYTES})).open()"
    subprocess.run([sys.executable, *words, str(folder)], env=variables, check=True)


def judge_life(numbers: Sequence[int], *, first: int, sent: int, seconds: float) -> Life:
    """Compares what the bags have of a life with what was sent. first: above all numbers of earlier lives."""
    own = [number for number in numbers if number >= first]
    newest = max(own, default=first)
    oldest = min(own, default=first)
    return Life(seconds, len(own), max(0, sent - newest), newest - oldest + 1 - len(own) if own else 0)


def run(folder: Path, *, kills: int, variables: Mapping[str, str]) -> Result:
    """Kills the recorder so often."""
    lives: list[Life] = []
    problems: list[str] = []
    disk_use = DiskUse(folder)
    opened_bags, first = 0, 0
    allowed = CHUNK_BYTES // MESSAGE_BYTES + 1 + UNDER_WAY
    disk_use.start()
    with talking(variables) as lines:
        for kill in range(1, kills + 1):
            seconds, sent = live_once(folder, variables, lines)
            complete(folder, variables)
            numbers: list[int] = []
            for path in sorted(folder.glob(f"*{CLOSED}")):
                try:
                    numbers += read_numbers(path)
                    opened_bags += 1
                except Exception as error:  # noqa: BLE001 - whatever the reader raises, the bag does not open
                    problems.append(f"kill {kill}: {path.name} does not open: {error!r}")
            if numbers != sorted(set(numbers)):
                problems.append(f"kill {kill}: messages twice or in another order")
            life = judge_life(numbers, first=first, sent=sent, seconds=seconds)
            lives.append(life)
            if life.lost > allowed:
                problems.append(f"kill {kill}: {life.lost} messages lost, the open chunk holds {allowed}")
            say(
                f"kill {kill} after {life.seconds:.1f} s: {life.kept} kept, {life.lost} lost, {life.gaps} missing between"
            )
            first = sent + UNDER_WAY
    disk_use.end()
    excess = max(0, disk_use.most_bytes - RETAIN_BYTES)
    if excess > SPLIT_BYTES:
        problems.append(f"all bags exceeded the bound by {excess} bytes, a split has {SPLIT_BYTES}")
    return Result(
        kills=kills,
        kept=sum(life.kept for life in lives),
        most_lost=max(life.lost for life in lives),
        allowed=allowed,
        gaps=sum(life.gaps for life in lives),
        opened_bags=opened_bags,
        excess_bytes=excess,
        split_bytes=SPLIT_BYTES,
        problems=problems,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Returns 1 when a bound did not hold."""
    parser = argparse.ArgumentParser(prog="scripts/bench recordings", description=__doc__)
    parser.add_argument("--kills", type=options.count(1, 1000), default=20)
    parser.add_argument("--seed", type=options.count(0), default=42)
    parser.add_argument("--json", type=options.report, help="file for the figures")
    read = parser.parse_args(arguments)
    random.seed(read.seed)
    with tempfile.TemporaryDirectory() as scratch:
        home, folder = Path(scratch) / "jazzy", Path(scratch) / "bags"
        home.mkdir()
        folder.mkdir()
        version = f"{sys.version_info.major}.{sys.version_info.minor}"
        wheels.install(wheels.requirements(*Ros2Jazzy.selection), home, python=version)
        result = run(folder, kills=read.kills, variables=environment(home))
    save(read.json, asdict(result))
    print(
        f"{result.kills} kills: {result.opened_bags} times a bag was opened, {result.kept} messages kept, at most {result.most_lost} lost by one kill "
        f"(the open chunk and what is under way: {result.allowed}), {result.gaps} missing between; the bound of {RETAIN_BYTES >> 20} MiB exceeded "
        f"by at most {result.excess_bytes / SPLIT_BYTES:.2f} of a split"
    )
    for problem in result.problems:
        print(f"NOT HELD: {problem}")
    return 1 if result.problems else 0


if __name__ == "__main__":
    raise SystemExit(main())
