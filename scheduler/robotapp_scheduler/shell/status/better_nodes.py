"""Writes the annotation `robotics.io/better-node` of pods, as `core.cycle.better_node` decides it.

The write goes to the pod's status, which may change annotations: the right to change pods themselves would take in their
images. It is on condition of the pod's uid and resourceVersion, so it is about the pod that was looked at or fails.
"""

import logging
from collections.abc import Callable
from typing import Any

from robotapp_api.model.names import Annotation
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import PODS
from robotapp_client.transport.errors import ApiError, ClientError, Conflict, NotFound, means_another
from robotapp_scheduler.core.cycle.better_node import TICK_S, AnnotationWrite, BudgetWatch

log = logging.getLogger(__name__)


class BetterNodes:
    """`run` on the leader. What could not be written is written again when it still holds."""

    def __init__(self, client: ApiClient, watch: BudgetWatch, *, permitted: Callable[[], bool] = lambda: True) -> None:
        """`permitted` is called before every write: whether we still lead."""
        self._client = client
        self._watch = watch
        self._permitted = permitted

    def __repr__(self) -> str:
        return f"<BetterNodes {self._watch!r}>"

    async def run(self) -> None:
        """Watch and write until cancelled."""
        while True:
            await self._client.sleep(TICK_S)
            for write in self._decided():
                await self._write(write)

    def _decided(self) -> list[AnnotationWrite]:
        if not self._permitted():
            return []
        try:
            return self._watch.tick()
        except Exception:  # a bug here must not stop the scheduler; nothing is half done
            log.exception("looking for better nodes failed")
            return []

    async def _write(self, write: AnnotationWrite) -> None:
        if not self._permitted():
            return
        meta = write.pod.metadata
        try:
            await self._client.patch(PODS, meta.name, patch_of(write), namespace=meta.namespace, subresource="status")
        except ClientError as error:
            changed = isinstance(error, Conflict | NotFound) or (isinstance(error, ApiError) and means_another(error))
            level = logging.DEBUG if changed else logging.WARNING
            log.log(level, "%s of %s cannot be written: %s", Annotation.BETTER_NODE, write.pod.key, error)
            self._watch.failed(meta.uid)
        else:
            text = f"would be better on {write.better.node}" if write.better else "is no longer better elsewhere"
            log.info("%s %s", write.pod.key, text)


def patch_of(write: AnnotationWrite) -> dict[str, Any]:
    """The merge patch; null removes the annotation."""
    meta = write.pod.metadata
    text = write.better.text() if write.better is not None else None
    return {
        "metadata": {
            "uid": meta.uid,
            "resourceVersion": meta.resource_version,
            "annotations": {Annotation.BETTER_NODE.value: text},
        }
    }
