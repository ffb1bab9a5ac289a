"""Takes the snapshot of the host that discovery works on, and remembers of it what cannot have changed."""

import re
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Final, NamedTuple

from robotapp_agent.devices.tree import (
    MARKS,
    MOST_TEXT,
    USB_ATTRIBUTES,
    USB_DEVICE,
    VIRTUAL,
    Entry,
    Folder,
    Snapshot,
    Wanted,
)
from robotapp_agent.shell.host.files import Bounds, Budget, Stopped, Tree

_READ_ANEW_AFTER: Final = 30
"""Scans. An attribute may change while its device stays; nothing that names a device does."""
_DEVICES: Final = "devices/"
_NO_DRIVERS: Final = frozenset({"port", "ctrl", "usb"})
"""Drivers of the kernel's own layers between a function and its device."""
_DRIVER_LEVELS: Final = 4
_DEVICE_NUMBER: Final = re.compile(r"[0-9]{1,4}:[0-9]{1,7}")
_MOST_PROPERTIES: Final = 128
_BOUNDS: Final = Bounds()


class HostPaths(NamedTuple):
    """Where the host's trees are mounted."""

    sys: Path
    dev: Path
    udev: Path
    """/run/udev; need not exist."""
    proc: Path

    @classmethod
    def below(cls, root: Path) -> "HostPaths":
        """All trees at their usual places below `root`."""
        return cls(root / "sys", root / "dev", root / "run/udev", root / "proc")


class _Known(NamedTuple):
    """An entry of an earlier scan, None for one that does not count, and the mark of its folder then."""

    target: str
    mark: tuple[int, int] | None
    entry: Entry | None


class SysfsReader:
    """Takes one snapshot after another."""

    def __init__(
        self,
        paths: HostPaths,
        *,
        bounds: Bounds = _BOUNDS,
        clock: Callable[[], float] = time.monotonic,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> None:
        self._paths = paths
        self._bounds = bounds
        self._clock = clock
        self._cancelled = cancelled
        self._known: dict[tuple[str, str], _Known] = {}
        self._folders: dict[str, tuple[tuple[int, int] | None, Mapping[str, str]]] = {}
        self._wanted = Wanted()
        self._scans = 0

    def __repr__(self) -> str:
        return f"SysfsReader({self._paths.sys}, {len(self._known)} entries known)"

    def read(self, wanted: Wanted) -> Snapshot:
        """Never raises for what it finds; what could not be read is named in `problem`."""
        if wanted != self._wanted or self._scans % _READ_ANEW_AFTER == 0:
            self._known, self._folders, self._wanted = {}, {}, wanted
        self._scans += 1
        budget = Budget(self._bounds, self._clock, self._cancelled)
        with ExitStack() as stack:
            roots = (
                self._paths.sys,
                self._paths.udev / "data",
                self._paths.dev,
                self._paths.proc / "driver/nvidia/gpus",
            )
            sys, udev, dev, nvidia = (stack.enter_context(Tree(root, budget)) for root in roots)
            scan = _Scan(sys, udev, wanted, known=self._known, folders=self._folders)
            problem = scan.run() if sys.exists else "it is not there"
            self._known, self._folders = scan.kept, scan.kept_folders
            try:
                marks = frozenset(name for name in MARKS if dev.mark(name) is not None)
                cards = tuple(name for name in nvidia.names("") if name.isascii())
            except (Stopped, OSError) as error:
                marks, cards, problem = frozenset(), (), problem or str(error)
        return Snapshot(
            entries=tuple(scan.entries),
            folders={path: attributes for path, (_, attributes) in scan.kept_folders.items()},
            marks=marks,
            nvidia=cards,
            problem=f"{self._paths.sys}: {problem}" if problem else "",
        )


class _Scan:
    """One pass over sysfs."""

    def __init__(
        self,
        sys: Tree,
        udev: Tree,
        wanted: Wanted,
        *,
        known: Mapping[tuple[str, str], _Known],
        folders: Mapping[str, tuple[tuple[int, int] | None, Mapping[str, str]]],
    ) -> None:
        self._sys = sys
        self._udev = udev
        self._wanted = wanted
        self._known = known
        self._known_folders = folders
        self.entries: list[Entry] = []
        self.kept: dict[tuple[str, str], _Known] = {}
        self.kept_folders: dict[str, tuple[tuple[int, int] | None, Mapping[str, str]]] = {}

    def run(self) -> str:
        """Why something may be missing, "" when nothing is."""
        problem = ""
        for folder in self._wanted.folders:
            try:
                for name in self._sys.names(folder.path):
                    if name.isascii() and name.isprintable() and folder.names.fullmatch(name):
                        self._take(folder, name)
            except OSError as error:
                problem = problem or f"{folder.path} cannot be read ({error.strerror})"
            except Stopped as error:
                return str(error)
        return problem

    def _take(self, folder: Folder, name: str) -> None:
        target = self._sys.link(folder.path, name)
        if not target.startswith(_DEVICES) or (target.startswith(VIRTUAL) and not folder.virtual):
            return
        mark = self._sys.mark(target)
        key = (folder.path, name)
        known = self._known.get(key)
        if known is None or known.target != target or known.mark != mark or mark is None:
            known = _Known(target, mark, self._entry(folder, name, target))
        self.kept[key] = known
        if known.entry is not None:
            self._parents(target)
            self.entries.append(self._with_properties(folder, known.entry))

    def _entry(self, folder: Folder, name: str, target: str) -> Entry | None:
        if folder.gate is not None:
            attribute, pattern = folder.gate
            if not pattern.fullmatch(self._sys.text(target, attribute) or ""):
                return None
        parts = target.split("/")
        above = "/".join(parts[:-2] if len(parts) > 2 and parts[-2] == folder.subsystem else parts[:-1])
        udev = ("dev", "ifindex") if self._udev.exists else ()
        return Entry(
            subsystem=folder.subsystem,
            name=name,
            path=target,
            attributes=self._texts(target, (*folder.attributes, *self._wanted.attributes, *udev)),
            parent_attributes=self._texts(above, folder.parent_attributes),
            driver=self._driver(above) if folder.driver else "",
        )

    def _texts(self, path: str, attributes: tuple[str, ...]) -> dict[str, str]:
        texts = ((attribute, self._sys.text(path, attribute)) for attribute in dict.fromkeys(attributes))
        return {attribute: text for attribute, text in texts if text is not None}

    def _driver(self, path: str) -> str:
        parts = path.split("/")
        for end in range(len(parts), max(0, len(parts) - _DRIVER_LEVELS), -1):
            driver = self._sys.link("/".join(parts[:end]), "driver").rpartition("/")[2]
            if driver and driver not in _NO_DRIVERS:
                return driver
        return ""

    def _parents(self, target: str) -> None:
        """What names the USB devices on the way, and what rules ask for."""
        parts = target.split("/")
        for end in range(2, len(parts) + 1):
            path = "/".join(parts[:end])
            usb = USB_ATTRIBUTES if USB_DEVICE.fullmatch(parts[end - 1]) else ()
            if path not in self.kept_folders and (usb or self._wanted.attributes):
                mark = self._sys.mark(path)
                known = self._known_folders.get(path)
                if known is None or known[0] != mark or mark is None:
                    known = (mark, self._texts(path, (*usb, *self._wanted.attributes)))
                self.kept_folders[path] = known

    def _with_properties(self, folder: Folder, entry: Entry) -> Entry:
        if not (self._udev.exists and (folder.properties or self._wanted.properties)):
            return entry
        number, index = entry.attributes.get("dev", ""), entry.attributes.get("ifindex", "")
        name = f"c{number}" if _DEVICE_NUMBER.fullmatch(number) else f"n{index}" if index.isdigit() else ""
        text = self._udev.content("", name) if name else None
        properties = _properties(text or "")
        if not properties:
            return entry
        return Entry(
            subsystem=entry.subsystem,
            name=entry.name,
            path=entry.path,
            attributes=entry.attributes,
            parent_attributes=entry.parent_attributes,
            driver=entry.driver,
            properties=properties,
        )


def _properties(text: str) -> dict[str, str]:
    """The lines `E:KEY=value` of an entry of udev's database."""
    lines = (line[2:].partition("=") for line in text.split("\n")[:_MOST_PROPERTIES] if line.startswith("E:"))
    return {key: value[:MOST_TEXT] for key, equals, value in lines if equals}
