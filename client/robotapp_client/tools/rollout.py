"""Restart of a Deployment's pods, as `kubectl rollout restart` does it."""

from collections.abc import Mapping
from typing import Any, Final

from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import DEPLOYMENTS

RESTARTED_AT: Final = "kubectl.kubernetes.io/restartedAt"
"""The annotation of a pod template that `kubectl rollout restart` writes: a new value rolls the pods."""


async def restart_deployment(client: ApiClient, deployment: Mapping[str, Any], *, at: str) -> None:
    """Has the Deployment replace its pods by its own strategy. Its uid keeps the write from another one of that name.

    at: the time that is written (RFC 3339). Raises ClientError.
    """
    meta = deployment["metadata"]
    template = {"metadata": {"annotations": {RESTARTED_AT: at}}}
    patch = {"metadata": {"uid": meta["uid"]}, "spec": {"template": template}}
    await client.patch(DEPLOYMENTS, meta["name"], patch, namespace=meta["namespace"])
