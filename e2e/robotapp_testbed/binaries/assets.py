"""Get the binaries of the control plane: given folders, then the cache, then official releases, then compile."""

import os
from collections.abc import Iterable, Mapping
from functools import partial
from itertools import chain
from pathlib import Path

from robotapp_testbed.binaries import cache, gobuild, pins, release
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.progress import Progress

FOLDER_VARIABLES = ("ROBOTAPP_ASSETS", "KUBEBUILDER_ASSETS")
_DOWNLOAD_S = 8.0


class Assets:
    """Resolves names of binaries to paths. `env` and `home` are replaced in tests."""

    def __init__(
        self,
        *,
        env: Mapping[str, str] = os.environ,
        home: Path | None = None,
        progress: Progress | None = None,
        base_urls: Mapping[str, str] | None = None,
    ) -> None:
        self._env = env
        self._home = home or cache.cache_home(env)
        self._progress = progress or Progress()
        self._base_urls = {**release.base_urls(env), **(base_urls or {})}

    def resolve(self, names: Iterable[str]) -> dict[str, Path]:
        """Paths of all `names`, downloading or compiling what is missing; TestbedError says what to do if it cannot."""
        wanted = sorted(map(pins.binary, names), key=pins.BINARIES.index)  # what they cost is known in this order
        found = self.present(binary.name for binary in wanted)
        missing = [binary for binary in wanted if binary.name not in found]
        if not missing:
            return found
        pins.platform_names()
        self._progress.say(f"Control plane: getting {', '.join(binary.name for binary in missing)} into {self._home}")
        try:
            found |= self._download([binary for binary in missing if binary.release])
            return found | gobuild.build_all(
                [binary for binary in missing if binary.name not in found],
                cache.built_store(home=self._home),
                home=self._home,
                progress=self._progress,
                env=self._env,
            )
        except OSError as error:
            raise TestbedError(
                f"the cache {self._home} cannot be used ({error}): make room there, or set XDG_CACHE_HOME to a folder you may write"
            ) from error

    def present(self, names: Iterable[str] = pins.NAMES) -> dict[str, Path]:
        """What is there already; touches nothing."""
        folders = self._folders()
        stores = (cache.built_store(home=self._home), cache.release_store(home=self._home))
        found: dict[str, Path] = {}
        for name in names:
            given = (place for place in (folder / name for folder in folders) if _is_program(place))
            cached = (place for store in stores if (place := store.get(name)))
            path = next(chain(given, cached), None)
            if path:
                found[name] = path
        return found

    def _folders(self) -> list[Path]:
        folders = []
        for variable in FOLDER_VARIABLES:
            value = self._env.get(variable, "")
            if value and not Path(value).is_dir():
                raise TestbedError(f"{variable}={value} is not a folder: correct it, or run `unset {variable}`")
            if value:
                folders.append(Path(value))
        return folders

    def _download(self, wanted: list[pins.Binary]) -> dict[str, Path]:
        store = cache.release_store(home=self._home)
        downloader = release.Downloader(self._base_urls)
        found: dict[str, Path] = {}
        offered = [binary for binary in wanted if downloader.offers(binary)]
        self._progress.plan([(f"downloading {binary.name}", _DOWNLOAD_S) for binary in offered])
        for binary in offered:
            if not downloader.offers(binary):  # its source was given up on meanwhile
                continue
            announce_wait = partial(
                self._progress.say, f"{binary.name} is being downloaded by another process: waiting for it"
            )
            try:
                with (
                    self._progress.step(f"downloading {binary.name}") as note,
                    store.adding(binary.name, on_wait=announce_wait) as target,
                ):
                    if target:
                        downloader.fetch(binary, target, note=note)
                found[binary.name] = store.path(binary.name)
            except release.ReleaseProblem as problem:
                self._progress.say(f"{problem}: compiling instead")
        return found


def _is_program(path: Path) -> bool:
    return path.is_file() and os.access(path, os.X_OK)
