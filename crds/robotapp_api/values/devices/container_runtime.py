"""Finds container runtimes that leave devices of ResourceClaims out of containers without a word."""

import re
from typing import Final

_VERSION: Final = re.compile(r"([a-z-]+)://v?([0-9]{1,4})\.([0-9]{1,4}).*")
_FIRST_WITH_CDI: Final = {"containerd": (1, 7), "cri-o": (1, 23)}
"""The first releases that read CDI specs; containerd 1.7 does so with `enable_cdi = true`, which a node does not publish."""


def describe_missing_cdi(runtime_version: str) -> str:
    """Returns why containers of this runtime get no devices of claims, with the cure; "" where nothing speaks against it.

    runtime_version: `status.nodeInfo.containerRuntimeVersion` of a node, such as containerd://1.6.20.
    """
    version = _VERSION.fullmatch(runtime_version)
    first = _FIRST_WITH_CDI.get(version[1]) if version else None
    if version is None or first is None or (int(version[2]), int(version[3])) >= first:
        return ""
    return (
        f"its container runtime {runtime_version} reads no CDI specs, so containers would start without their devices: upgrade it to "
        "containerd 2, containerd 1.7 with enable_cdi = true, or CRI-O 1.23"
    )
