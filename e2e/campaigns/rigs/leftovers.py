"""What a module of live tests leaves in the control plane it shares with the others: nothing that they could meet."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from robotapp_api.model.names import API_VERSION, SYSTEM_NAMESPACE
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.real import RealNodes

OURS: Final = f"/apis/{API_VERSION}"
CLUSTER_WIDE: Final = (
    "/api/v1/nodes",
    "/api/v1/persistentvolumes",
    "/apis/storage.k8s.io/v1/storageclasses",
    "/apis/scheduling.k8s.io/v1/priorityclasses",
    f"{OURS}/nodetelemetries",
    f"{OURS}/domainpools",
)
PASSING: Final = ("/api/v1/pods", f"{OURS}/robotapps")
"""They go with the namespace of their test, and a module waits for it."""
INSTALLED: Final = {
    "domainpools/default",
    "priorityclasses/system-cluster-critical",
    "priorityclasses/system-node-critical",
}
GONE_S: Final = 120.0
"""Of some hundred pods: 30 s on a machine that has seven other things to do."""


def leftovers(plane: ControlPlane) -> set[str]:
    """What nobody will remove, as kind/name."""
    own = {f"nodes/{name}" for name in plane.nodes} if isinstance(plane, RealNodes) else set()
    return {*_names(plane, (*CLUSTER_WIDE, *PASSING))} - INSTALLED - own


def settled(plane: ControlPlane, before: set[str]) -> set[str]:
    """The leftovers beyond those of `before`, after what is on its way out has been hurried along.

    Nodes of a module are gone before its pods are, so nobody would confirm that these have ended; and nobody is left to
    sweep the claims of its apps, or to give back the Lease of an operator that was killed.
    """
    namespaces = _items(plane, "/api/v1/namespaces")
    ending = [item["metadata"]["name"] for item in namespaces if item["metadata"].get("deletionTimestamp")]
    busy = {item["metadata"]["namespace"] for item in _items(plane, f"{OURS}/robotapps")}
    for name in ending:
        _delete(plane, f"/api/v1/namespaces/{name}/pods?gracePeriodSeconds=0")
        if name in busy:  # where there were pods, the namespace controller comes back for the rest after five seconds
            _delete(plane, f"{OURS}/namespaces/{name}/robotapps")
    wait_until(lambda: before >= set(_names(plane, PASSING)), timeout_s=GONE_S, poll_s=0.1)
    for collection in (f"{OURS}/robotclaims", f"/apis/coordination.k8s.io/v1/namespaces/{SYSTEM_NAMESPACE}/leases"):
        if _items(plane, collection):
            plane.api.delete(collection)
    return leftovers(plane) - before


def _delete(plane: ControlPlane, collection: str) -> None:
    """As often as it takes: all of a large one may take a busy server longer than an answer may."""
    deadline_s = time.monotonic() + GONE_S
    while True:
        try:
            plane.api.delete(collection)
        except TimeoutError:
            if time.monotonic() > deadline_s:
                raise
        else:
            return


def _names(plane: ControlPlane, collections: Iterable[str]) -> Iterable[str]:
    for collection in collections:
        for item in _items(plane, collection):
            yield f"{collection.rpartition('/')[2]}/{item['metadata']['name']}"


def _items(plane: ControlPlane, collection: str) -> list[dict[str, Any]]:
    try:
        items: list[dict[str, Any]] = plane.api.get(collection)["items"]
    except ApiStatusError as error:
        if error.status != 404:  # our kinds are not installed in every session
            raise
        return []
    return items


@contextmanager
def leaving_nothing_behind(plane: Callable[[], ControlPlane | None]) -> Iterator[None]:
    """Fails when what runs inside leaves objects in the control plane that other modules would meet."""
    control_plane = plane()
    before = leftovers(control_plane) if control_plane else set()
    yield
    control_plane = plane()
    objects = settled(control_plane, before) if control_plane else set()
    assert not objects, f"other modules would meet what this one leaves: {sorted(objects)}"
