"""Writes that pages offer, each one request as the user. All raise ClientError; `uid` keeps them from another object of that name."""

from collections.abc import Mapping

from robotapp_api.model.names import Annotation, Label
from robotapp_api.values.naming import child_name
from robotapp_client import ApiClient, NotFound
from robotapp_client.api.resources import DEPLOYMENTS, ROBOTAPPS, Resource
from robotapp_client.tools.rollout import restart_deployment


class NothingToChangeError(Exception):
    """There is nothing of this kind to change; the text names it."""


async def set_suspend(client: ApiClient, namespace: str, name: str, *, uid: str, suspend: bool) -> None:
    """Stops all pods of an app, or lets them start again."""
    await client.patch(ROBOTAPPS, name, {"metadata": {"uid": uid}, "spec": {"suspend": suspend}}, namespace=namespace)


async def approve_update(client: ApiClient, namespace: str, name: str, *, uid: str, version: str) -> None:
    """Lets the operator of this version write its own templates."""
    await annotate(client, ROBOTAPPS, name, {Annotation.APPROVE_UPDATE: version}, namespace=namespace, uid=uid)


async def delete_app(client: ApiClient, namespace: str, name: str, *, uid: str) -> None:
    """Deletes the app; its pods go with it, and its domain and devices become free."""
    await client.delete(ROBOTAPPS, name, namespace=namespace, uid=uid)


async def restart_component(
    client: ApiClient, namespace: str, app: str, *, uid: str, robot: str, component: str, at: str
) -> None:
    """Rolls the pods of a component as `kubectl rollout restart` does. Raises NothingToChangeError for one that has not started, or a name that the app does not own."""
    name = child_name(app, robot, component)
    try:
        deployment = await client.get(DEPLOYMENTS, name, namespace=namespace)
    except NotFound as error:
        text = f"{component} has not started, so there is nothing to restart. Its message on the app's page says what it waits for."
        raise NothingToChangeError(text) from error
    if (deployment["metadata"].get("labels") or {}).get(Label.APP_UID) != uid:
        raise NothingToChangeError(f"Deployment {namespace}/{name} does not belong to the app.")
    await restart_deployment(client, deployment, at=at)


async def annotate(
    client: ApiClient,
    resource: Resource,
    name: str,
    annotations: Mapping[str, str | None],
    *,
    namespace: str = "",
    uid: str = "",
) -> None:
    """Sets annotations of an object; None removes one."""
    meta = {"annotations": dict(annotations)} | ({"uid": uid} if uid else {})
    await client.patch(resource, name, {"metadata": meta}, namespace=namespace or None)
