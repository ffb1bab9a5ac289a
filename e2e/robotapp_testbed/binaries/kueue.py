"""Builds kueue's controller manager and finds its release's manifests, for the bench in which it admits Jobs.

It is compiled from e2e/kueue/go.mod when the bench runs first, and kept in the cache. The manifests are files of the
same module.
"""

import json
import os
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import cache, gobuild, pins, toolchain
from robotapp_testbed.failures import TestbedError, last_words
from robotapp_testbed.progress import Progress

VERSION: Final = "v0.17.0"
MODULE_DIR: Final = pins.REPOSITORY / "e2e" / "kueue"
_MODULE: Final = "sigs.k8s.io/kueue"
LDFLAGS: Final = f"-s -w -X {_MODULE}/pkg/version.GitVersion={VERSION}"
BINARY: Final = pins.Binary(name="kueue", package=f"{_MODULE}/cmd/kueue", compile_s=240, packages=1100, release=None)


def build(*, progress: Progress | None = None, env: Mapping[str, str] = os.environ) -> Path:
    """Compiles the manager unless the cache has it; returns its path."""
    home = cache.cache_home(env)
    store = cache.built_store(home=home, module_dir=MODULE_DIR, ldflags=LDFLAGS)
    if present := store.get(BINARY.name):
        return present
    paths = gobuild.build_all(
        [BINARY],
        store,
        home=home,
        progress=progress or Progress(),
        env=env,
        version=VERSION,
        module_dir=MODULE_DIR,
        ldflags=LDFLAGS,
    )
    return paths[BINARY.name]


def find_manifests(env: Mapping[str, str] = os.environ) -> Path:
    """Returns the folder of the module from which `kubectl kustomize` makes the release's manifests; the build has
    downloaded it.
    """
    go = toolchain.find(env, home=cache.cache_home(env))
    if go is None:
        raise TestbedError("there is no Go to find kueue's manifests with: build the manager first")
    download = subprocess.run(
        [str(go.program), "mod", "download", "-json", f"{_MODULE}@{VERSION}"],
        cwd=MODULE_DIR,
        env=gobuild.build_environment(env),
        capture_output=True,
        text=True,
        check=False,
    )
    if download.returncode != 0:
        raise TestbedError(f"kueue {VERSION} cannot be downloaded: {last_words(download.stdout + download.stderr)}")
    return Path(json.loads(download.stdout)["Dir"]) / "config" / "default"
