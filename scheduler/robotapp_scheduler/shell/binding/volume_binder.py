"""Writes a pod's volume decisions before the bind: sets volumes aside for claims, requests new ones, waits until all are bound.

The volume controller and the provisioners do the rest. Nothing written here is undone: the next attempt, also of another
process, finds the volume set aside for the claim, or the claim with its selected node, and continues from there.
"""

import asyncio
import logging
from collections.abc import Callable
from typing import Any

from robotapp_api.values.selector import matches_node_terms
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import PERSISTENTVOLUMECLAIMS, PERSISTENTVOLUMES
from robotapp_client.transport.errors import ClientError
from robotapp_scheduler.core.api.kept_annotations import BOUND_BY_CONTROLLER, SELECTED_NODE
from robotapp_scheduler.core.api.storage_v1 import Claim, PersistentVolume
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.events.cluster_event import Change
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan
from robotapp_scheduler.core.volumes.volume_users import ClaimKey

log = logging.getLogger(__name__)

LOOK_S = 1.0
"""Longest pause between two checks while no event comes, as upstream."""
INTERESTING = int(Change.PV | Change.PVC)
TIMED_OUT = "binding volumes: context deadline exceeded"
Versions = dict[ClaimKey | str, int]
"""Resource version of each claim and volume as we wrote it."""


class UnbindableError(Exception):
    """The claims cannot be bound as decided; the pod has to be scheduled again."""


class VolumeWriter:
    """One per process. `wake` is to be called on every change of a claim or volume; `alive(uid)`: does the pod still wait?"""

    def __init__(
        self, client: ApiClient, cluster: Cache, *, alive: Callable[[str], bool], clock: Callable[[], float]
    ) -> None:
        self._client = client
        self._cluster = cluster
        self._alive = alive
        self._clock = clock
        self._waiting: set[asyncio.Event] = set()

    def __repr__(self) -> str:
        return f"<VolumeWriter, {len(self._waiting)} pods wait for volumes>"

    def notify(self) -> None:
        """A claim or volume changed."""
        for event in self._waiting:
            event.set()

    async def bind(self, pod: PodInfo, plan: VolumePlan) -> str:
        """Write the plan and wait until every claim is bound. Returns why it cannot be, "" when it is; raises no error of the
        API server.
        """
        try:
            versions = await self._write(plan)
            await self._wait(pod, plan, versions)
        except (UnbindableError, ClientError) as error:
            return str(error)
        return ""

    # --- Writing ---------------------------------------------------------------------------------------------------

    async def _write(self, plan: VolumePlan) -> Versions:
        store = self._cluster.volumes
        versions: Versions = {}
        for key, name in plan.bindings:
            volume, claim = store.volumes.get(name), store.claims.get(key)
            if volume is None or claim is None:
                raise UnbindableError(f"persistentvolume {name!r} or persistentvolumeclaim {key[1]!r} is gone")
            patch = volume_patch(volume, claim)
            if patch is not None:
                written = await self._client.patch(PERSISTENTVOLUMES, name, patch)
                versions[name] = _version(written)
        for key in plan.provisions:
            claim = store.claims.get(key)
            if claim is None:
                raise UnbindableError(f"persistentvolumeclaim {key[1]!r} is gone")
            patch = claim_patch(claim, plan.node)
            if patch is not None:
                written = await self._client.patch(PERSISTENTVOLUMECLAIMS, key[1], patch, namespace=key[0])
                versions[key] = _version(written)
        return versions

    # --- Waiting ---------------------------------------------------------------------------------------------------

    async def _wait(self, pod: PodInfo, plan: VolumePlan, versions: Versions) -> None:
        deadline_s = self._clock() + plan.timeout_s
        event = asyncio.Event()
        self._waiting.add(event)
        try:
            while not self._done(pod, plan, versions):
                left_s = deadline_s - self._clock()
                if left_s <= 0:
                    raise UnbindableError(TIMED_OUT)
                try:
                    await asyncio.wait_for(event.wait(), min(LOOK_S, left_s))
                except TimeoutError:
                    continue
                event.clear()
        finally:
            self._waiting.discard(event)

    def _done(self, pod: PodInfo, plan: VolumePlan, versions: Versions) -> bool:
        """Is every claim bound? Raises UnbindableError when it will not be."""
        if not self._alive(pod.uid):
            raise UnbindableError(f'binding volumes: pod does not exist any more: pod "{pod.name}" not found')
        return all(self._given(plan, key, name, versions) for key, name in plan.bindings) and all(
            self._made(plan, key, versions) for key in plan.provisions
        )

    def _given(self, plan: VolumePlan, key: ClaimKey, name: str, versions: Versions) -> bool:
        volume, claim = self._volume(name), self._claim(key)
        if _old(volume.metadata.resource_version, versions.get(name)):
            return False
        self._check_reach(volume, plan.node)
        if volume.spec.claim_ref is None or not volume.spec.claim_ref.uid:
            raise UnbindableError(f'binding volumes: ClaimRef got reset for pv "{name}"')
        return claim.bound

    def _made(self, plan: VolumePlan, key: ClaimKey, versions: Versions) -> bool:
        claim = self._claim(key)
        if _old(claim.metadata.resource_version, versions.get(key)):
            return False
        if (claim.metadata.annotations or {}).get(SELECTED_NODE) != plan.node:
            # A provisioner that cannot make the volume removes the annotation: another node may do.
            raise UnbindableError(f'binding volumes: provisioning failed for PVC "{key[1]}"')
        if claim.spec.volume_name:
            volume = self._cluster.volumes.volumes.get(claim.spec.volume_name)
            if volume is None:
                return False  # its watch is behind
            self._check_reach(volume, plan.node)
        return claim.bound

    def _volume(self, name: str) -> PersistentVolume:
        volume = self._cluster.volumes.volumes.get(name)
        if volume is None:
            raise UnbindableError(
                f'binding volumes: failed to check binding: could not find v1.PersistentVolume "{name}"'
            )
        return volume

    def _claim(self, key: ClaimKey) -> Claim:
        claim = self._cluster.volumes.claims.get(key)
        if claim is None:
            found = f'could not find v1.PersistentVolumeClaim "{key[0]}/{key[1]}"'
            raise UnbindableError(f"binding volumes: failed to check binding: {found}")
        return claim

    def _check_reach(self, volume: PersistentVolume, node: str) -> None:
        row = self._cluster.nodes.row_of.get(node)
        if row is None:
            raise UnbindableError(f'binding volumes: failed to get node "{node}": node "{node}" not found')
        try:
            affinity = self._cluster.volumes.affinity_on(volume, node)
        except ValueError as error:
            raise UnbindableError(f"binding volumes: failed to translate pv to csi: {error}") from error
        labels = self._cluster.nodes.labels.of(row)
        if affinity is not None and not matches_node_terms(affinity.node_selector_terms, labels, ""):
            name = volume.metadata.name
            raise UnbindableError(
                f'binding volumes: pv "{name}" node affinity doesn\'t match node "{node}": no matching NodeSelectorTerms'
            )


def volume_patch(volume: PersistentVolume, claim: Claim) -> dict[str, Any] | None:
    """Merge patch that gives a volume to a claim, for exactly this version of it; None when it has it already."""
    ref, meta = volume.spec.claim_ref, claim.metadata
    given = ref is not None and ref.means(claim)
    if given and ref is not None and ref.uid == meta.uid:
        return None
    metadata: dict[str, Any] = {
        "uid": volume.metadata.uid,
        "resourceVersion": volume.metadata.resource_version,
    }
    if not given:
        # Without the annotation it stays visible that a user set the volume aside.
        metadata["annotations"] = {BOUND_BY_CONTROLLER: "yes"}
    reference = {
        "apiVersion": "v1",
        "kind": "PersistentVolumeClaim",
        "namespace": meta.namespace,
        "name": meta.name,
        "uid": meta.uid,
        "resourceVersion": meta.resource_version,
    }
    return {"metadata": metadata, "spec": {"claimRef": reference}}


def claim_patch(claim: Claim, node: str) -> dict[str, Any] | None:
    """Merge patch that requests a volume for the claim on this node; None when the claim has the annotation already."""
    if (claim.metadata.annotations or {}).get(SELECTED_NODE) == node:
        return None
    meta = claim.metadata
    return {
        "metadata": {
            "uid": meta.uid,
            "resourceVersion": meta.resource_version,
            "annotations": {SELECTED_NODE: node},
        }
    }


def _version(written: dict[str, Any]) -> int:
    return int(written["metadata"]["resourceVersion"])


def _old(version: str, written: int | None) -> bool:
    """Is what the watch showed older than what we wrote?"""
    return written is not None and version.isdigit() and int(version) < written
