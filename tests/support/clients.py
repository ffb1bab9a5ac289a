"""Clients for tests: short patience, known name."""

from typing import Any

from robotapp_api.client import ApiClient, Endpoint


def client_for(endpoint: Endpoint, **overrides: Any) -> ApiClient:
    """An ApiClient whose requests give up after two seconds instead of thirty."""
    settings: dict[str, Any] = {"user_agent": "robotapp-test", "field_manager": "robotapp-test", "timeout_s": 2.0}
    return ApiClient(endpoint, **(settings | overrides))


def configmap(
    name: str, *, namespace: str = "default", labels: dict[str, str] | None = None, **data: str
) -> dict[str, Any]:
    meta: dict[str, Any] = {"name": name, "namespace": namespace}
    if labels:
        meta["labels"] = labels
    return {"apiVersion": "v1", "kind": "ConfigMap", "metadata": meta, "data": data}
