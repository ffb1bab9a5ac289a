"""Memory that large temporary objects needed goes back to the system."""

import ctypes
from typing import Final

M_MMAP_THRESHOLD: Final = -3
"""Parameter of mallopt(3). Set by hand, glibc does not raise it to the size of the largest object that was freed."""


def return_large_objects(size_bytes: int) -> None:
    """Has glibc return objects of this size, or larger ones, to the system as soon as they are freed.

    By itself it raises the size with every larger object that is freed, up to 32 MiB, and keeps what is smaller between objects that stay.
    """
    if mallopt := getattr(ctypes.CDLL(None), "mallopt", None):  # other C libraries have none
        mallopt(M_MMAP_THRESHOLD, size_bytes)
