"""Debian packages as image content: apt resolves and verifies them against an empty system, we unpack, nothing is installed.

So the interpreter in an image is Debian's own, of this machine's release, whether or not the machine has it installed and
whatever Python runs us. Which versions those are is part of an image's inputs.
"""

import functools
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import cache
from robotapp_testbed.failures import TestbedError, last_words

_PROGRAMS: Final = ("apt-get", "dpkg-deb", "tar")
_ESSENTIAL_ELSEWHERE: Final = (
    # Wanted only by maintainer scripts, which do not run here.
    *("adduser", "debconf", "dirmngr", "dpkg", "gnupg", "gpg", "init-system-helpers", "libfile-find-rule-perl"),
    *("libnumber-compare-perl", "libpam", "libperl", "libtext-glob-perl", "lsb-base", "passwd", "perl", "pinentry"),
    *("sgml-base", "sysvinit-utils", "tar", "usrmerge", "xml-core"),
)
_LEFT_OUT: Final = ("usr/share/doc", "usr/share/man", "usr/share/locale", "usr/share/lintian", "usr/share/info")
_LEFT_OUT_ANYWHERE: Final = ("__pycache__", "gconv", "ensurepip", "idlelib", "pydoc_data", "lib2to3")
_MERGED: Final = ("bin", "sbin", "lib", "lib64")


@dataclass(frozen=True, slots=True)
class Package:
    file: str  # has the version in its name
    size: str
    checksum: str = ""

    @property
    def name(self) -> str:
        return self.file.partition("_")[0]


def closure(names: Sequence[str]) -> tuple[Package, ...]:
    """Returns what must be unpacked, in apt's order, so that `names` run.

    apt is asked once per process: it takes a second of CPU, and the inputs of every image and its layers depend on it.
    """
    return _resolve(tuple(names))


@functools.cache
def _resolve(names: tuple[str, ...]) -> tuple[Package, ...]:
    lines = _apt("--print-uris", names).splitlines()
    # 'URI' file size [checksum]: some archives give apt their checksums only when it fetches.
    found = [Package(*fields[1:4]) for fields in map(str.split, lines) if len(fields) >= 3]
    return tuple(package for package in found if not package.name.startswith(_ESSENTIAL_ELSEWHERE))


def unpack(names: Sequence[str], layer: Path, *, without: Sequence[str] = ()) -> None:
    """Fill `layer` with the closure of `names`, less that of `without` (a lower layer)."""
    below = set(closure(without)) if without else set()
    wanted = [package for package in closure(names) if package not in below]
    for name in _MERGED:  # Debian's merged /usr: the packages themselves do not bring these links
        (layer / "usr" / name).mkdir(parents=True, exist_ok=True)
        (layer / name).symlink_to(f"usr/{name}")
    folder = _fetch(tuple(names), cache.cache_home() / "debian")
    for package in wanted:
        _extract(folder / package.file, layer)


@functools.cache
def _fetch(names: tuple[str, ...], folder: Path) -> Path:
    (folder / "partial").mkdir(parents=True, exist_ok=True)
    with cache.locked(folder / ".lock"):
        _apt("--download-only", names, f"Dir::Cache::archives={folder}", "Debug::NoLocking=1")
    return folder


def _apt(action: str, names: Sequence[str], *options: str) -> str:
    lacking = [program for program in _PROGRAMS if shutil.which(program) is None]
    if lacking:
        raise TestbedError(
            f"images with Python are made of Debian packages, and {', '.join(lacking)} is missing: build them on Debian or Ubuntu"
        )
    command = ["apt-get", "install", "-qq", "--yes", "--no-install-recommends", action]
    command += [f"--option={option}" for option in ("Dir::State::status=/dev/null", *options)]
    result = subprocess.run([*command, *names], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        reason = last_words(result.stderr)
        raise TestbedError(f"apt cannot get {', '.join(names)} ({reason}): apt-get update, then try again")
    return result.stdout


def _extract(package: Path, layer: Path) -> None:
    unwanted = [f"--exclude=./{path}" for path in _LEFT_OUT]
    unwanted += [f"--exclude={name}" for name in _LEFT_OUT_ANYWHERE]
    with subprocess.Popen(["dpkg-deb", "--fsys-tarfile", package], stdout=subprocess.PIPE) as archive:
        command = ["tar", "--extract", "--keep-directory-symlink", "--no-same-owner", *unwanted]
        subprocess.run([*command, "--directory", layer], stdin=archive.stdout, check=True)
    if archive.returncode != 0:
        raise TestbedError(f"{package} cannot be unpacked: remove it and try again")
