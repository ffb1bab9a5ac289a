"""Which nodes hold which container images, and how large those are."""

from typing import Final

import numpy as np

from robotapp_scheduler.core.api.core_v1 import NodeImage
from robotapp_scheduler.core.nodes.columns import IntArray

MOST_KNOWN: Final = 65536


class _Image:
    """One image name: its size as the first of its present nodes reported it, and their rows."""

    __slots__ = ("rows", "size_bytes")

    def __init__(self, size_bytes: int) -> None:
        self.size_bytes = size_bytes
        self.rows: dict[int, None] = {}


class Images:
    """Images by name. Nodes with the same list share it."""

    __slots__ = ("_images", "_known", "_lists", "_of_row")

    def __init__(self) -> None:
        self._images: dict[str, _Image] = {}
        self._known: dict[NodeImage, NodeImage] = {}
        """Entries of the lists: the same image is on many nodes."""
        self._of_row: dict[int, tuple[NodeImage, ...]] = {}
        self._lists: dict[tuple[NodeImage, ...], tuple[tuple[NodeImage, ...], int]] = {}

    def __repr__(self) -> str:
        return f"Images({len(self._images)} names on {len(self._of_row)} nodes)"

    def apply(self, row: int, images: tuple[NodeImage, ...]) -> bool:
        """Replace what a row reports, () for a node that is gone; True when that is different."""
        old = self._of_row.get(row, ())
        if old == images:
            return False
        self._take_off(row, old)
        if images:
            self._put_on(row, self._shared(images))
        return True

    def of(self, row: int) -> tuple[NodeImage, ...]:
        """What a row reports; equal entries of different nodes are the same object."""
        return self._of_row.get(row, ())

    def bytes_of(self, names: tuple[str, ...], rows: int, nodes: int) -> IntArray:
        """Σ int(size · nodes that have it / all nodes) of these images per row, each mention counted."""
        total = np.zeros(rows, dtype=np.int64)
        for name in names:
            image = self._images.get(name)
            if image is not None:
                scaled = int(float(image.size_bytes) * (float(len(image.rows)) / float(nodes)))
                total[list(image.rows)] += scaled
        return total

    def any(self, names: tuple[str, ...]) -> bool:
        """Does any node hold any of these images?"""
        return any(name in self._images for name in names)

    def _put_on(self, row: int, images: tuple[NodeImage, ...]) -> None:
        self._of_row[row] = images
        for image in images:
            for name in image.names or ():
                known = self._images.get(name)
                if known is None:
                    known = self._images[name] = _Image(image.size_bytes)
                known.rows[row] = None

    def _take_off(self, row: int, images: tuple[NodeImage, ...]) -> None:
        self._of_row.pop(row, None)
        if not images:
            return
        shared, users = self._lists[images]
        if users == 1:
            del self._lists[images]
        else:
            self._lists[images] = (shared, users - 1)
        for image in images:
            for name in image.names or ():
                known = self._images.get(name)
                if known is not None:
                    known.rows.pop(row, None)
                    if not known.rows:
                        del self._images[name]

    def _shared(self, images: tuple[NodeImage, ...]) -> tuple[NodeImage, ...]:
        shared, users = self._lists.get(images, ((), 0))
        if not users:
            if len(self._known) >= MOST_KNOWN:
                self._known.clear()
            shared = tuple(self._known.setdefault(image, image) for image in images)
        self._lists[shared] = (shared, users + 1)
        return shared
