"""What is in each image: a recipe fills a folder per layer and says how a container starts."""

import os
import shutil
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import pins, programs
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.images.oci import Config

_EMPTY_FOLDERS: Final = ("tmp", "etc", "proc", "sys", "dev", "run")
PATH: Final = "/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin"


class Recipe(ABC):
    @abstractmethod
    def inputs(self) -> bytes:
        """Everything the content depends on: the archive is kept under the hash of it."""

    @abstractmethod
    def fill(self, scratch: Path) -> Sequence[Path]:
        """Make the layers' folders below `scratch`; lowest layer first."""

    @abstractmethod
    def config(self) -> Config: ...


class Pause(Recipe):
    """The sandbox of every pod: one static program."""

    def inputs(self) -> bytes:
        return programs.build("pause").read_bytes()

    def fill(self, scratch: Path) -> Sequence[Path]:
        layer = scratch / "pause"
        layer.mkdir()
        shutil.copyfile(programs.build("pause"), layer / "pause")
        (layer / "pause").chmod(0o755)
        return [layer]

    def config(self) -> Config:
        return Config(entrypoint=["/pause"], architecture=pins.platform_names()["arch"])


class Tools(Recipe):
    """A shell, ping, nslookup, wget …: Debian's static busybox under all its names."""

    def inputs(self) -> bytes:
        return _busybox().read_bytes()

    def fill(self, scratch: Path) -> Sequence[Path]:
        layer = skeleton(scratch / "tools")
        binaries = layer / "bin"
        binaries.mkdir()
        shutil.copyfile(_busybox(), binaries / "busybox")
        (binaries / "busybox").chmod(0o755)
        listed = subprocess.run([_busybox(), "--list"], capture_output=True, text=True, check=True).stdout.split()
        for name in sorted(set(listed) - {"busybox"}):
            (binaries / name).symlink_to("busybox")
        return [layer]

    def config(self) -> Config:
        return Config(entrypoint=["/bin/sh"], architecture=pins.platform_names()["arch"], env={"PATH": PATH})


def skeleton(layer: Path) -> Path:
    """The folders and the two files every program may expect."""
    for name in _EMPTY_FOLDERS:
        (layer / name).mkdir(parents=True)
    (layer / "tmp").chmod(0o1777)
    (layer / "etc" / "passwd").write_text("root:x:0:0:root:/:/bin/sh\nrobot:x:65532:65532:robot:/tmp:/bin/sh\n")
    (layer / "etc" / "group").write_text("root:x:0:\nrobot:x:65532:\n")
    return layer


def _busybox() -> Path:
    found = shutil.which("busybox", path=f"{os.defpath}:/usr/sbin:/sbin")
    if found is None or b"/ld-linux" in Path(found).read_bytes():  # the other busybox package needs a libc beside it
        raise TestbedError(
            "the tool image is made from the static busybox, which is missing: apt-get install busybox-static"
        )
    return Path(found)
