"""containerd 2 for real nodes that hand out devices: the 1.6 of Debian 12 leaves devices of claims out without a word.

Compiled from e2e/container_runtime/go.mod when a test or a command asks for it (about three minutes on two cores), kept in the
cache. runc is the machine's.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import cache, gobuild, pins
from robotapp_testbed.progress import Progress

VERSION: Final = "v2.2.9"
MODULE_DIR: Final = pins.REPOSITORY / "e2e" / "container_runtime"
_MODULE: Final = "github.com/containerd/containerd/v2"
LDFLAGS: Final = f"-s -w -X {_MODULE}/version.Version={VERSION}"


def _binary(name: str, *, compile_s: int, packages: int) -> pins.Binary:
    return pins.Binary(name=name, package=f"{_MODULE}/cmd/{name}", compile_s=compile_s, packages=packages, release=None)


BINARIES: Final = (
    _binary("containerd", compile_s=150, packages=1100),
    _binary("containerd-shim-runc-v2", compile_s=10, packages=40),
    _binary("ctr", compile_s=15, packages=60),
)


def build(*, progress: Progress | None = None, env: Mapping[str, str] = os.environ) -> Path:
    """The folder with containerd, its shim and ctr, for the front of PATH; compiles what is missing. Raises TestbedError."""
    home = cache.cache_home(env)
    store = cache.built_store(home=home, module_dir=MODULE_DIR, ldflags=LDFLAGS)
    gobuild.build_all(
        [binary for binary in BINARIES if store.get(binary.name) is None],
        store,
        home=home,
        progress=progress or Progress(),
        env=env,
        version=VERSION,
        module_dir=MODULE_DIR,
        ldflags=LDFLAGS,
    )
    return store.directory
