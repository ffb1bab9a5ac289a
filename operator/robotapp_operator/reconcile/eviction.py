"""Ends a pod by the eviction API, so that disruption budgets hold. The operator may delete no pod in another way."""

import logging
from typing import Final

from robotapp_api.client import ApiClient, Conflict, Forbidden, NotFound, ServerError, TooManyRequests
from robotapp_api.client.api.bodies import encode
from robotapp_api.client.api.resources import PODS
from robotapp_operator.plan.spec.objects import Pod

log = logging.getLogger(__name__)

SEVERAL_BUDGETS: Final = 500
"""Status of the answer to an eviction of a pod that more than one PodDisruptionBudget covers: it will not pass by itself."""


async def evict(client: ApiClient, pod: Pod, *, version: str = "") -> str | None:
    """Evict the pod. Returns why the API server refused, "" when the pod is being deleted, None when it was gone before.

    version: the pod must still have this resourceVersion, else None; "" for any.
    """
    meta = pod.metadata
    preconditions = {"uid": meta.uid} | ({"resourceVersion": version} if version else {})
    body = {
        "apiVersion": "policy/v1",
        "kind": "Eviction",
        "metadata": {"name": meta.name, "namespace": meta.namespace},
        "deleteOptions": {"preconditions": preconditions},
    }
    try:
        await client.post_raw(PODS.path(meta.namespace, meta.name, "eviction"), encode(body))
    except (TooManyRequests, Forbidden) as refusal:  # a disruption budget, or rights of an older chart
        return refusal.message
    except ServerError as refusal:
        if refusal.status != SEVERAL_BUDGETS:
            raise
        return refusal.message
    except (NotFound, Conflict) as gone:
        log.info("pod %s/%s is gone already: %s", meta.namespace, meta.name, gone)
        return None
    return ""
