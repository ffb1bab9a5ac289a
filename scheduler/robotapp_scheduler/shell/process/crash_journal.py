"""Records, in a folder that outlives the process, during which call of a third-party plugin the process died, and for which pod.

The running call is recorded in a page of memory that is also a file: the kernel keeps it however the process dies. After one
death in a hook that cannot be interrupted the call is no longer made. Where the process died for an unknown reason during a call
(one that never returned, a crash in native code, out of memory) it takes two deaths, because one may be chance.
"""

import fcntl
import logging
import mmap
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import msgspec

from robotapp_scheduler.core.framework.interface import PluginError
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.core.framework.third_party import is_ours
from robotapp_scheduler.core.pods.pod_info import PodInfo

log = logging.getLogger(__name__)

CHANCES: Final = 2
"""Deaths of the process during the same call after which the call is no longer made."""
MOST: Final = 100
"""Calls kept in the journal; the oldest are dropped."""
PAGE_BYTES: Final = 4096
NOTED: Final = 5
"""Lines of a note: digest, plugin, hook, pod, owner."""
MARK: Final = "asking"
DEATHS: Final = "deaths.json"


class CrashRecord(msgspec.Struct, frozen=True):
    """The call during which the process died. `alike` is the uid of the pod's controller, else its own: it stands for pods like it.

    The names of the fields are those in the file.
    """

    plugin: str
    hook: str
    pod: str
    alike: str
    stuck: bool = False
    """The hook could not be interrupted."""
    times: int = 1

    @property
    def counts(self) -> bool:
        """Whether the plugin is no longer called for such pods."""
        return self.stuck or self.times >= CHANCES

    def __str__(self) -> str:
        why = (
            f"{self.hook} could not be broken off and the process had to end"
            if self.stuck
            else f"the process died {self.times} times while {self.hook} was asked"
        )
        return f"not asked about pods like {self.pod} any more, because {why}; a new configuration or scheduler pod asks again"


class _JournalFile(msgspec.Struct):
    """The file. Deaths under another configuration (`digest`) do not count."""

    digest: str
    deaths: list[CrashRecord] = []


class CrashJournal:
    """Called with (plugin, hook, pod), it is a context for that call of the plugin; one call at a time."""

    def __init__(self, folder: Path, digest: str) -> None:
        """`digest` is that of the configuration in use. Raises OSError when the folder cannot be used, also on a full disk and
        while another process uses it.
        """
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._file = folder / DEATHS
        self._digest = digest
        self._page = _page(folder / MARK)
        self._deaths = {(death.plugin, death.alike): death for death in self._read()}
        left = self._left()
        self._clear()
        if left is not None:
            self._add(left)

    def __repr__(self) -> str:
        return f"<CrashJournal in {self._file.parent}, {len(self._deaths)} deaths>"

    @property
    def barred(self) -> list[CrashRecord]:
        """The calls that are not made any more."""
        return [death for death in self._deaths.values() if death.counts]

    def __call__(self, plugin: str, hook: str, pod: PodInfo) -> Self:
        """Record a call that is about to be made. Raises PluginError when it must not be."""
        alike = _owner_uid(pod)
        death = self._deaths.get((plugin, alike)) if self._deaths else None
        if death is not None and death.counts:
            raise PluginError(plugin, str(death))
        # The length is written last: a note that was cut off before has none.
        note = f"{self._digest}\n{plugin}\n{hook}\n{pod.key}\n{alike}".encode()[: PAGE_BYTES - 2]
        self._page[2 : 2 + len(note)] = note
        self._page[0:2] = len(note).to_bytes(2, "little")
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._clear()

    def stuck(self, plugin: str, hook: str, pod: PodInfo) -> None:
        """The process is about to end, because this hook cannot be interrupted."""
        self._clear()
        self._add(CrashRecord(plugin, hook, pod.key, _owner_uid(pod), stuck=True))

    def start_anew(self, digest: str) -> None:
        """Another configuration is in use: every plugin may be called again."""
        self._digest = digest
        if self._deaths:
            self._deaths = {}
            self._write()

    def watch_over(self, profiles: Mapping[str, Profile]) -> None:
        """Record every call of a plugin of another author; to be called once, before the profiles are used."""
        for loaded in (each for profile in profiles.values() for each in profile.everywhere):
            if not is_ours(loaded.plugin):
                loaded.journal = self

    def _add(self, death: CrashRecord) -> None:
        known = self._deaths.pop((death.plugin, death.alike), None)
        if known is not None:
            death = msgspec.structs.replace(death, times=known.times + 1, stuck=known.stuck or death.stuck)
        self._deaths[death.plugin, death.alike] = death
        while len(self._deaths) > MOST:
            self._deaths.pop(next(iter(self._deaths)))
        self._write()

    def _clear(self) -> None:
        self._page[0:2] = b"\0\0"

    def _left(self) -> CrashRecord | None:
        """The call that was running when the process before this one ended."""
        length = int.from_bytes(self._page[0:2], "little")
        parts = self._page[2 : 2 + length].decode(errors="replace").split("\n") if length else []
        if len(parts) != NOTED or parts[0] != self._digest:
            return None
        _, plugin, hook, pod, alike = parts
        return CrashRecord(plugin, hook, pod, alike)

    def _read(self) -> Iterable[CrashRecord]:
        try:
            with open(self._file, "rb", opener=_no_link) as file:
                memory = msgspec.json.decode(file.read(), type=_JournalFile)
        except FileNotFoundError:
            return ()
        except (OSError, ValueError, RecursionError) as error:  # whatever a broken disk left there
            log.warning("%s cannot be read, nothing is remembered: %s", self._file, error)
            return ()
        return memory.deaths if memory.digest == self._digest else ()

    def _write(self) -> None:
        """May run in the middle of a plugin that is stuck: it is quick, and its failure is only logged."""
        data = msgspec.json.encode(_JournalFile(self._digest, list(self._deaths.values())))
        new = self._file.with_suffix(".new")
        try:
            with open(new, "wb", opener=_no_link) as file:
                file.write(data)
            new.replace(self._file)
        except OSError as error:
            log.warning("%s cannot be written: %s", self._file, error)


def opened(folder: Path | None, digest: str) -> CrashJournal | None:
    """The journal of this folder; None without one. Where it cannot be used the log has the reason, and pods are placed all the same."""
    if folder is None:
        return None
    try:
        journal = CrashJournal(folder, digest)
    except OSError as error:
        log.warning("--state-dir: plugins that end the process will not be remembered: %s", error)
        return None
    for death in journal.barred:
        log.error("plugin %s: %s", death.plugin, death)
    return journal


def unwatched(profile: Profile) -> None:
    """The calls of its plugins are no longer recorded."""
    for loaded in profile.everywhere:
        loaded.journal = None


def _owner_uid(pod: PodInfo) -> str:
    owner = pod.controller
    return owner.uid if owner is not None and owner.uid else pod.uid


def _page(path: Path) -> mmap.mmap:
    """Ours alone as long as it is mapped: the map keeps a copy of the handle, and with it the lock."""
    handle = _no_link(path, os.O_RDWR | os.O_CREAT)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # two in one folder would blame each other's plugins
        os.posix_fallocate(handle, 0, PAGE_BYTES)  # a hole in the file is SIGBUS at the first note on a full disk
        return mmap.mmap(handle, PAGE_BYTES)
    except BlockingIOError as error:
        raise BlockingIOError(error.errno, "another process uses the folder", str(path)) from error
    finally:
        os.close(handle)


def _no_link(path: str | Path, flags: int) -> int:
    """A handle on the file itself: a symbolic link in the folder is not followed."""
    return os.open(path, flags | os.O_NOFOLLOW, 0o600)
