"""The kube-scheduler release whose decisions a plugin gives: a few formulas changed between 1.35 and 1.37."""

from typing import Final

OLD: Final = "1.35"
NEW: Final = "1.37"


def is_new(compat_version: str) -> bool:
    """True for 1.37. Raises ValueError for a release nobody compared with."""
    if compat_version not in {OLD, NEW}:
        raise ValueError(f"compatVersion: {compat_version!r} is unknown; allowed: {OLD}, {NEW}")
    return compat_version == NEW
