"""Control planes of other Kubernetes versions than the testbed's own, for `scripts/bench versions`.

Only Kubernetes' servers differ; etcd, kwok, helm and kubectl stay the testbed's own. Each version has a Go module of its
own under e2e/controlplane, because one module can hold only one version of Kubernetes.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from robotapp_testbed.binaries import cache, gobuild, pins
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.progress import Progress

OTHERS: Final = {"1.35": "v1.35.4", "1.36": "v1.36.3"}
"""Minor version, which is also the folder of its Go module, → the release that is compiled."""
PROGRAMS: Final = ("kube-apiserver", "kube-controller-manager", "kube-scheduler")


def module_dir(minor: str) -> Path:
    if minor not in OTHERS:
        raise TestbedError(f"Kubernetes {minor} is not among the versions to compile, which are {', '.join(OTHERS)}")
    return pins.MODULE_DIR / minor


def servers(minor: str, *, progress: Progress | None = None, env: Mapping[str, str] = os.environ) -> Path:
    """The folder with PROGRAMS of that version, for ROBOTAPP_ASSETS. Compiles what is missing (about ten minutes on two cores)."""
    folder, ldflags = module_dir(minor), pins.ldflags(OTHERS[minor])
    home = cache.cache_home(env)
    store = cache.built_store(home=home, module_dir=folder, ldflags=ldflags)
    missing = [pins.binary(name) for name in PROGRAMS if store.get(name) is None]
    gobuild.build_all(
        missing,
        store,
        home=home,
        progress=progress or Progress(),
        env=env,
        version=OTHERS[minor],
        module_dir=folder,
        ldflags=ldflags,
    )
    return store.directory
