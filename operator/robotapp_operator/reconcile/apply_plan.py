"""Carries out a plan, stops and evicts. Every write of a template is conditional on the resourceVersion read before the claims were listed.

The plan decides what is written; here a write over a version that the plan does not know is refused.
"""

import dataclasses
import logging
from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec

from robotapp_api.model.names import OPERATOR_MANAGER, QUEUE_NAME, Annotation, Reason
from robotapp_claims.rules.domain import Fence
from robotapp_client import (
    AlreadyExists,
    ApiClient,
    ApiError,
    BadRequest,
    Conflict,
    Forbidden,
    Invalid,
    NamespaceTerminating,
    NotFound,
    ServerError,
    TooManyRequests,
)
from robotapp_client.api.bodies import JSON_PATCH, encode
from robotapp_client.api.client import JsonPatch, with_query
from robotapp_client.api.resources import DEPLOYMENTS, JOBS, PODS, SERVICES, Resource
from robotapp_operator.plan.diff.diff import Change, Observed, Plan, ref_of
from robotapp_operator.plan.diff.scaled import note_scaled
from robotapp_operator.plan.diff.unowned import unowned_pointers
from robotapp_operator.plan.render.child import DEPLOYMENT, JOB, SERVICE
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.plan.spec.objects import ChildRef, Deployment, Job, Meta, Pod, version_number
from robotapp_operator.plan.status.components import over_quota
from robotapp_operator.queue.work import StartOver

log = logging.getLogger(__name__)

RESOURCES: Final[Mapping[str, Resource]] = {DEPLOYMENT: DEPLOYMENTS, JOB: JOBS, SERVICE: SERVICES}
SEVERAL_BUDGETS: Final = 500
"""Status of the answer to an eviction of a pod that more than one PodDisruptionBudget covers: it will not pass by itself."""


@dataclasses.dataclass(slots=True)
class Written:
    """The result of a run: objects as stored now (`versions`: uid and version), and refusals that the user must resolve."""

    versions: dict[ChildRef, tuple[str, int]] = dataclasses.field(default_factory=dict)
    settled: dict[str, tuple[int, str]] = dataclasses.field(default_factory=dict)
    refusals: list[tuple[Reason, str]] = dataclasses.field(default_factory=list)
    scaled: list[str] = dataclasses.field(default_factory=list)
    """Texts of events about Deployments that others had scaled."""
    count: int = 0


async def execute(client: ApiClient, app: App, plan: Plan, *, fences: Mapping[str, Fence], version: str) -> Written:
    """Write the plan. Deletes come first: a renamed component must not run beside its old self. Raises StartOver on 409 and 404,
    NamespaceTerminating where nothing can be created any more.
    """
    done = Written()
    for item in plan.deletes:
        await _delete(client, item, is_awaited=item.metadata.uid in plan.awaited)
        done.count += 1
    for change in plan.changes:
        try:
            result = await _write(client, app, change, done, fences=fences, version=version)
        except NamespaceTerminating:
            raise
        except (Forbidden, Invalid) as refusal:
            done.refusals.append(_rejection(change, refusal))
            continue
        except AlreadyExists:
            done.refusals.append(await _name_taken(client, app, change))
            continue
        except (Conflict, NotFound) as race:
            raise StartOver(str(race)) from race
        meta = result["metadata"]
        done.settled[meta["uid"]] = (meta.get("generation", 0), change.child.hash)
        done.versions[change.child.ref] = (meta["uid"], version_number(meta["resourceVersion"]))
        done.count += 1
    return done


async def stop(client: ApiClient, item: Deployment | Job) -> None:
    """Scales the Deployment to 0, or suspends the Job, and changes nothing else. Raises StartOver when it has changed.

    A Job in a queue is deleted, because kueue would resume it.
    """
    meta = item.metadata
    if isinstance(item, Job) and QUEUE_NAME in meta.labels:
        await _delete(client, item)
        return
    stopped = ("/spec/suspend", True) if isinstance(item, Job) else ("/spec/replicas", 0)
    patch: JsonPatch = [
        {"op": "test", "path": "/metadata/resourceVersion", "value": meta.resource_version},
        {"op": "add", "path": stopped[0], "value": stopped[1]},
    ]
    try:
        await _patch_tested(client, RESOURCES[ref_of(item).kind], meta.name, patch, namespace=meta.namespace)
    except (Conflict, NotFound) as race:
        raise StartOver(str(race)) from race


async def evict(client: ApiClient, pod: Pod, *, version: str = "", dry_run: bool = False) -> str | None:
    """Evict the pod. Returns why the API server refused, "" when the pod is being deleted, None when it was gone before.

    By the eviction API, so that disruption budgets hold: the operator may delete no pod in another way.
    version: the pod must still have this resourceVersion, else None; "" for any. dry_run: only find out what the answer would
    be; also "" where a webhook of the cluster cannot be tried. Raises NamespaceTerminating.
    """
    meta = pod.metadata
    preconditions = {"uid": meta.uid} | ({"resourceVersion": version} if version else {})
    body = {
        "apiVersion": "policy/v1",
        "kind": "Eviction",
        "metadata": {"name": meta.name, "namespace": meta.namespace},
        "deleteOptions": {"preconditions": preconditions} | ({"dryRun": ["All"]} if dry_run else {}),
    }
    # Webhooks look at the parameter, disruption budgets at the body.
    path = with_query(PODS.path(meta.namespace, meta.name, "eviction"), {"dryRun": "All" if dry_run else ""})
    try:
        await client.post_raw(path, encode(body))
    except BadRequest as refusal:  # "admission webhook … does not support dry run"
        if not dry_run:
            raise
        log.info("the eviction of pod %s/%s cannot be tried: %s", meta.namespace, meta.name, refusal)
        return ""
    except NamespaceTerminating:
        raise
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


async def _write(
    client: ApiClient, app: App, change: Change, done: Written, *, fences: Mapping[str, Fence], version: str
) -> dict[str, Any]:
    child, over = change.child, change.over
    resource = RESOURCES[child.ref.kind]
    body = child.body(app, version=version)
    if over is None:
        return await client.create(resource, body)
    fence = fences.get(child.ref.name) if child.ref.kind == DEPLOYMENT else None
    if fence is None:
        fence = Fence(over.metadata.uid, over.metadata.resource_version)
    if change.amended is not None or change.records:
        # No apply: a field of the newer operator's that we do not render would be removed by it, and a Job's template cannot be written.
        patch: JsonPatch = [{"op": "test", "path": "/metadata/resourceVersion", "value": fence.resource_version}]
        if change.amended is not None:
            patch.append({"op": "replace", "path": "/spec", "value": change.amended})
        for key, value in change.records.items():
            patch.append({"op": "add", "path": f"/metadata/annotations/{key.replace('/', '~1')}", "value": value})
        return await _patch_tested(client, resource, child.ref.name, patch, namespace=app.namespace)
    live = await _read_fenced(client, resource, app.namespace, child.ref.name, fence)
    managed_fields = live["metadata"].get("managedFields") or []
    scaled = note_scaled(app, child, over, managed_fields)
    resource_version = await _own_by_apply(client, over, fence, managed_fields)
    body["metadata"] |= {"uid": fence.uid, "resourceVersion": resource_version}
    body["metadata"]["annotations"] |= _records(over)  # our own, which an apply without them would remove
    result = await client.apply(resource, body)
    done.scaled += [scaled] if scaled else []
    foreign = unowned_pointers(result.get("spec", {}), child.spec)
    if not foreign:
        return result
    version_test = {"op": "test", "path": "/metadata/resourceVersion", "value": result["metadata"]["resourceVersion"]}
    tested: JsonPatch = [version_test, *({"op": "remove", "path": pointer} for pointer in foreign)]
    return await _patch_tested(client, resource, child.ref.name, tested, namespace=app.namespace)


def _records(over: Observed) -> dict[str, str]:
    """Our annotations that record the component's past: moves and lost devices."""
    have = over.metadata.annotations
    return {key.value: have[key] for key in (Annotation.MOVES, Annotation.LOST_DEVICES) if key in have}


async def _read_fenced(
    client: ApiClient, resource: Resource, namespace: str, name: str, fence: Fence
) -> dict[str, Any]:
    """Reads the object with its managedFields, which no cache holds. Raises StartOver when it is not the one of the fence."""
    live = await client.get(resource, name, namespace=namespace)
    if live["metadata"]["uid"] != fence.uid or live["metadata"]["resourceVersion"] != fence.resource_version:
        raise StartOver(f"{name} changed since it was read")
    return live


async def _own_by_apply(
    client: ApiClient, over: Observed, fence: Fence, managed_fields: Sequence[Mapping[str, Any]]
) -> str:
    """Turn our managedFields of operation Update into Apply, or an apply could never remove such a field. Returns the new version.

    POST and PATCH are recorded as Update, which co-owns its fields for ever. Changing the record costs one write, and only
    for an object that was written so since its last apply.
    """
    changes = _owned_by_apply(managed_fields)
    if not changes:
        return fence.resource_version
    test: dict[str, Any] = {"op": "test", "path": "/metadata/resourceVersion", "value": fence.resource_version}
    resource, meta = RESOURCES[ref_of(over).kind], over.metadata
    result = await _patch_tested(client, resource, meta.name, [test, *changes], namespace=meta.namespace)
    version: str = result["metadata"]["resourceVersion"]
    return version


def _owned_by_apply(entries: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The JSON patch that merges our managedFields into one of operation Apply; empty when there is nothing to change."""
    ours = {
        entry.get("operation"): index
        for index, entry in enumerate(entries)
        if entry.get("manager") == OPERATOR_MANAGER and not entry.get("subresource")
    }
    update, apply = ours.get("Update"), ours.get("Apply")
    if update is None:
        return []
    path = "/metadata/managedFields"
    if apply is None:
        return [{"op": "replace", "path": f"{path}/{update}/operation", "value": "Apply"}]
    # Two records of one manager and operation: the server would keep only the later one.
    fields = _merged(entries[apply].get("fieldsV1") or {}, entries[update].get("fieldsV1") or {})
    return [
        {"op": "replace", "path": f"{path}/{apply}/fieldsV1", "value": fields},
        {"op": "remove", "path": f"{path}/{update}"},
    ]


def _merged(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """The union of two sets of fields, which are written as nested maps with empty leaves."""
    return {key: _merged(one.get(key, {}), other.get(key, {})) for key in {**one, **other}}


async def _patch_tested(
    client: ApiClient, resource: Resource, name: str, patch: JsonPatch, *, namespace: str
) -> dict[str, Any]:
    """Send a JSON patch that begins with a test. A failed test is a 422 without causes: it raises StartOver."""
    try:
        return await client.patch(resource, name, patch, namespace=namespace, content_type=JSON_PATCH)
    except Invalid as refusal:
        if refusal.causes:
            raise
        raise StartOver(f"{name} changed while it was written") from refusal


async def _delete(client: ApiClient, item: Observed, *, is_awaited: bool = False) -> None:
    """Deletes by uid: an object of this name with another uid is not the one that was planned for.

    A Job goes after its last pod, so that its successor's pod never runs beside it, and so does an object whose last
    pod is awaited.
    """
    meta = item.metadata
    ref = ref_of(item)
    propagation = "Foreground" if ref.kind == JOB or is_awaited else "Background"
    try:
        await client.delete(
            RESOURCES[ref.kind], ref.name, namespace=meta.namespace, uid=meta.uid, propagation=propagation
        )
    except (NotFound, Conflict):
        log.debug("%s %s is gone already", ref.kind, ref.name)


async def _name_taken(client: ApiClient, app: App, change: Change) -> tuple[Reason, str]:
    """A create met an object that the label selector does not find: ours without labels, an older app's, or another owner's."""
    ref = change.child.ref
    resource = RESOURCES[ref.kind]
    try:
        live = await client.get(resource, ref.name, namespace=app.namespace)
        meta = msgspec.convert(live["metadata"], Meta)
        owner = next((owner for owner in meta.owner_references if owner.controller), None)
        if owner is not None and owner.uid == app.uid:
            if change.child.labels.items() <= meta.labels.items():
                raise StartOver(f"{ref.kind} {ref.name} was not in the cache yet")
            patch = {"metadata": {"labels": change.child.labels, "resourceVersion": meta.resource_version}}
            await client.patch(resource, ref.name, patch, namespace=app.namespace)
            raise StartOver(f"{ref.kind} {ref.name} had lost its labels")
    except (NotFound, Conflict) as race:
        raise StartOver(str(race)) from race
    if owner is not None and (owner.kind, owner.name) == ("RobotApp", app.name):
        raise StartOver(f"{ref.kind} {ref.name} of the deleted app of this name is still there")
    return Reason.FAILED_CREATE, f"{ref.kind} {ref.name} exists and belongs to somebody else; delete or rename it"


def _rejection(change: Change, error: ApiError) -> tuple[Reason, str]:
    reason = Reason.QUOTA_REFUSED if over_quota(error.message) else Reason.FAILED_CREATE
    return reason, f"{change.child.ref.kind} {change.child.ref.name}: {error.message}"[:1024]
