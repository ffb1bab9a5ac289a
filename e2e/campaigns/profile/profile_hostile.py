"""Profile: damaged copies of a hostile package: no traceback, nothing outside the package touched, no profile that takes a second.

scripts/bench profile_hostile --packages 2000 --seed 1 --json FILE
"""

import argparse
import json
import os
import random
import sys
import tempfile
import time
import traceback
import unicodedata  # noqa: F401 - Python's parser imports it at the first name that is not ASCII, which is no reader's doing
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml
from tests.support.ros_sources import manifest, write

from campaigns.common import options
from ros_profile.generate import generate_profile
from ros_profile.output.difference import difference
from ros_profile.output.machine import as_annotations, as_json, as_rigelfile, from_json
from ros_profile.output.robotapp import as_robotapp
from ros_profile.output.text import text

_LISTS = frozenset({"os.listdir", "os.scandir"})
_FORBIDDEN = (
    *("subprocess.", "socket.", "ctypes.", "shutil.", "tempfile.", "pty.", "urllib.", "http.", "glob."),
    *("os.system", "os.exec", "os.fork", "os.posix_spawn", "os.spawn", "os.startfile", "os.chdir", "os.mkdir"),
    *("os.remove", "os.rename", "os.rmdir", "os.link", "os.symlink", "os.chmod", "os.chown", "os.truncate", "os.kill"),
    *("import", "exec", "marshal.", "pickle."),
)
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_watch: "Watch | None" = None


@dataclass(slots=True)
class Watch:
    """Reading below `allowed` is all that may happen. `found` lists every event that goes beyond it."""

    allowed: Path
    found: list[str] = field(default_factory=list)
    opened: int = 0

    def see(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" or event in _LISTS:
            self._path(event, arguments)
        elif event.startswith(_FORBIDDEN):
            self.found.append(f"{event} {arguments[:1]!r}")

    def _path(self, event: str, arguments: tuple[Any, ...]) -> None:
        given = arguments[0]
        if not given or not isinstance(given, str | bytes | os.PathLike):
            return  # a descriptor, which an open before this one gave; or no name at all, which opens nothing
        self.opened += event == "open"
        path = os.fsdecode(given)
        inside = Path(os.path.realpath(path)).is_relative_to(self.allowed)
        if not inside or (event == "open" and arguments[2] & _WRITES):
            self.found.append(f"{event} {path}")


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if _watch is not None:
        _watch.see(event, arguments)


sys.addaudithook(_hook)


@contextmanager
def watched(allowed: Path) -> Iterator[Watch]:
    """Every event within the block is judged; an audit hook cannot be removed, so it looks at what is set here."""
    global _watch  # noqa: PLW0603
    _watch = watch = Watch(Path(os.path.realpath(allowed)))
    try:
        yield watch
    finally:
        _watch = None


_BITS = (
    b"\0", b"\xff", b"\r", b"\t", b"'", b'"', b"(", b"]", b"{", b"&", b"*", b"<", b">", b"%", b"$(", b"\\ud800", b"\n", b": ",
    b"!!", b"\xef\xbb\xbf",
)  # fmt: skip


def mutated(data: bytes, chance: random.Random) -> bytes:
    """One to four changes: bytes put in, cut out, doubled, or a piece moved."""
    for _ in range(chance.randint(1, 4)):
        at, length = chance.randrange(len(data) + 1), chance.randint(0, 12)
        kind = chance.randrange(4)
        if kind == 0:
            data = data[:at] + chance.choice(_BITS) * chance.choice((1, 1, 2, 50)) + data[at:]
        elif kind == 1:
            data = data[:at] + data[at + length :]
        elif kind == 2:
            data = data[:at] + data[at : at + length] * chance.choice((2, 9)) + data[at + length :]
        else:
            other = chance.randrange(len(data) + 1)
            data = data[:at] + data[other : other + length] + data[at:]
    return data


SECRET: Final = "/dev/ttyUSB4711"
"""Stands in every file outside the package (hostile_package.yaml), and in none inside: no profile may hold it."""
_PACKAGE: Final = yaml.safe_load(Path(__file__).with_name("hostile_package.yaml").read_text())
_MANIFEST: Final = manifest("thing", depends=("rclcpp", "sensor_msgs"))


@dataclass(frozen=True)
class Hostile:
    """The package at `folder`; what it reaches for lies beside it in `outside`."""

    folder: Path
    files: dict[str, bytes]

    @classmethod
    def made(cls, root: Path) -> "Hostile":
        outside = write(root / "outside", _PACKAGE["outside"] | {"package.xml": manifest("outside")})
        files = {name: content.format(outside=outside).encode() for name, content in _PACKAGE["files"].items()}
        files["package.xml"] = _MANIFEST.encode()
        folder = write(root / "thing", files)
        for name, target in _PACKAGE["links"].items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).symlink_to(target.format(outside=outside))
        return cls(folder, files)

    @contextmanager
    def damaged(self, seed: int) -> Iterator[list[str]]:
        """One to three of its files damaged, in every twentieth case its manifest; whole again afterwards."""
        chance = random.Random(seed)
        sources = [name for name in self.files if name != "package.xml"]
        names = chance.sample(sources, chance.randint(1, 3))
        if seed % 20 == 0:
            names = ["package.xml"]
        for name in names:
            (self.folder / name).write_bytes(mutated(self.files[name], chance))
        try:
            yield names
        finally:
            for name in names:
                (self.folder / name).write_bytes(self.files[name])

    def problems(self) -> list[str]:
        """What the whole generator did wrong: left the package, ran or wrote something, raised, or knows a secret."""
        with watched(self.folder) as watch:
            try:
                written = everything(self.folder)
            except Exception:  # noqa: BLE001 - that is what is looked for
                return [traceback.format_exc(limit=-3)]
        known = [f"it knows {SECRET}"] if SECRET in written else []
        return [*watch.found, *known, *([] if watch.opened else ["it read nothing"])]


def everything(folder: Path) -> str:
    """The profile of a package in every format, one after another."""
    profile = generate_profile(folder)
    written = [text(profile, explain=True), as_json(profile), as_annotations(profile), as_rigelfile(profile)]
    written += difference(from_json(as_json(profile)), profile)
    for package in profile.packages:
        written += (as_robotapp(launch, name="thing", distro="jazzy") for launch in package.launches)
    return "\n".join(written)


def seconds(hostile: Hostile) -> float:
    """Processor time of one profile in every format."""
    begun = time.process_time()
    everything(hostile.folder)
    return time.process_time() - begun


HANG_S = 1.0
"""Processor time of one profile in all formats, above which a package hangs the profiler."""


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="scripts/bench profile_hostile", description=__doc__.splitlines()[0] if __doc__ else ""
    )
    parser.add_argument("--packages", type=options.count(1, 1_000_000), default=2000, help="damaged copies to try")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=options.report, help="also write the figures to this file")
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        result = _campaign(Hostile.made(Path(folder)), arguments.packages, arguments.seed)
    text = json.dumps(result, indent=2)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")
    return 1 if result["problems"] else 0


def _campaign(hostile: Hostile, packages: int, first: int) -> dict[str, object]:
    everything(hostile.folder)  # once, so that nothing is imported later
    problems: list[str] = []
    slowest, total = 0.0, 0.0
    for seed in range(first, first + packages):
        with hostile.damaged(seed) as names:
            found = hostile.problems()
            spent = seconds(hostile)
        slowest, total = max(slowest, spent), total + spent
        if spent > HANG_S:
            found.append(f"it took {spent:.2f} s")
        problems += (f"seed {seed}, {', '.join(names)}: {text}" for text in found)
    return {
        "packages": packages,
        "first_seed": first,
        "slowest_s": round(slowest, 3),
        "mean_s": round(total / packages, 4),
        "problems": problems[:50],
    }


if __name__ == "__main__":
    sys.exit(main())
