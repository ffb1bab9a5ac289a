"""Replace workloads of the thesis' time by RobotApps, one app after the other, with a way back."""

import json
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rigel_bridge.cluster import apps
from rigel_bridge.cluster.deployment import deploy
from rigel_bridge.cluster.kubectl import ClusterError, Kubectl, Refusal
from rigel_bridge.cluster.removal import remove
from rigel_bridge.cluster.waiting import Clock, wait_ready
from rigel_bridge.document.failures import BridgeError, Exit

KINDS: Final = (
    "deployments.apps",
    "replicasets.apps",
    "statefulsets.apps",
    "daemonsets.apps",
    "pods",
    "configmaps",
    "nodes",
)
MAX_CONFIG_MAPS: Final = 100
"""ConfigMaps with variables that are read, one call of kubectl for each."""
_SERVERS_OWN: Final = (
    "uid",
    "resourceVersion",
    "creationTimestamp",
    "generation",
    "managedFields",
    "ownerReferences",
    "selfLink",
)


@dataclass(frozen=True, slots=True)
class Limits:
    """Times in seconds."""

    gone_s: float = 120.0
    ready_s: float = 120.0


def read(
    kubectl: Kubectl,
    *,
    everywhere: bool,
    tell: Callable[[str], None],
    config_maps_of: Callable[[Mapping[str, Any]], Iterable[str]] = lambda _: (),
) -> list[dict[str, Any]]:
    """Reads all objects that a migration looks at, ConfigMaps by the names that `config_maps_of` gives for an object.

    Kinds that the user may not list are told and left out.
    """
    found: list[dict[str, Any]] = []
    for kind in KINDS:
        scope = ("--all-namespaces",) if everywhere and kind != "nodes" else ()
        only = ("--field-selector=metadata.name=robot-fleet-assignments",) if kind == "configmaps" else ()
        found += _items_or_none(kubectl, kind, *scope, *only, tell=tell)
    names = sorted({name for each in found for name in config_maps_of(each)})
    if len(names) > MAX_CONFIG_MAPS:
        tell(
            f"of {len(names)} ConfigMaps with variables only {MAX_CONFIG_MAPS} are looked at: migrate fewer namespaces at once"
        )
    scope = ("--all-namespaces",) if everywhere else ()
    for name in names[:MAX_CONFIG_MAPS]:
        found += _items_or_none(kubectl, "configmaps", *scope, f"--field-selector=metadata.name={name}", tell=tell)
    return found


def _items_or_none(kubectl: Kubectl, kind: str, *arguments: str, tell: Callable[[str], None]) -> list[dict[str, Any]]:
    try:
        return kubectl.items("get", kind, *arguments)
    except ClusterError as error:
        if error.reason is not Refusal.FORBIDDEN:
            raise
        tell(f"{kind} are not looked at: {error}")
        return []


def take_over(
    kubectl: Kubectl,
    app: Mapping[str, Any],
    old: Sequence[Mapping[str, Any]],
    *,
    limits: Limits,
    clock: Clock,
    tell: Callable[[str], None],
    backup: Path = Path(),
) -> None:
    """Delete the old workloads, wait until their pods are gone, bring the app in, wait until it is Ready.

    The old ones end first: two of them would publish the same commands and want the same devices. When the app does not become
    Ready, or the user interrupts, it is removed and the old workloads come back. What cannot come back is told, with its file
    in `backup`.
    """
    apps.apply(kubectl, app, dry_run=True)
    name = app["metadata"]["name"]
    if apps.read(kubectl, name) is not None:
        raise ClusterError(f"RobotApp {name} is there already: delete it, or leave this workload as it is")
    try:
        for each in old:
            _delete(kubectl, each, limits=limits, clock=clock)
        deploy(kubectl, app, tell=tell)
        wait_ready(kubectl, name, timeout_s=limits.ready_s, clock=clock, tell=tell)
    except BaseException:  # whatever it is: until they are back, nothing drives these robots
        tell(f"{name}: is removed again, and the old workloads come back (copies are in {backup})")
        _give_way(kubectl, name, old, limits=limits, clock=clock, tell=tell, backup=backup)
        raise


def _give_way(
    kubectl: Kubectl,
    name: str,
    old: Sequence[Mapping[str, Any]],
    *,
    limits: Limits,
    clock: Clock,
    tell: Callable[[str], None],
    backup: Path,
) -> None:
    """Remove the app and restore the old workloads. One that fails is told and leaves the others alone."""
    try:
        remove(kubectl, name, timeout_s=limits.gone_s, clock=clock)
    except BridgeError as error:
        tell(f"{error}")
        for each in old:
            tell(
                f"{_title(each)} is not restored, since pods of both would publish the same commands; {_by_hand(each, backup)}"
            )
        return
    for each in old:
        try:
            _restore(kubectl, each, limits=limits, clock=clock)
        except BridgeError as error:
            tell(f"{_title(each)} is not restored: {error}; {_by_hand(each, backup)}")


def _restore(kubectl: Kubectl, each: Mapping[str, Any], *, limits: Limits, clock: Clock) -> None:
    """Create an old workload again. One that is being deleted would take what is written to it along: that is waited for."""
    kind, name = str(each["kind"]).lower(), each["metadata"]["name"]

    def is_decided() -> bool:
        text = kubectl.run("get", kind, name, "--ignore-not-found", "-o", "json")
        return not text.strip() or "deletionTimestamp" not in json.loads(text)["metadata"]

    if not clock.until(is_decided, timeout_s=limits.gone_s):
        raise ClusterError(f"it is still being deleted after {limits.gone_s:g} s", code=Exit.NOT_READY)
    kubectl.run("apply", "--server-side", "--force-conflicts", "-f", "-", stdin=json.dumps(restorable(each)))


def backup_name(stored: Mapping[str, Any]) -> str:
    """The file of an old workload below the backup folder."""
    return f"{str(stored['kind']).lower()}-{stored['metadata']['name']}.json"


def _title(stored: Mapping[str, Any]) -> str:
    return f"{str(stored['kind']).lower()} {stored['metadata']['name']}"


def _by_hand(stored: Mapping[str, Any], backup: Path) -> str:
    return f"later: kubectl apply --server-side -f {shlex.quote(str(backup / backup_name(stored)))}"


def restorable(stored: Mapping[str, Any]) -> dict[str, Any]:
    """A stored object without what the API server writes, so that it can be created again."""
    metadata = {key: value for key, value in stored["metadata"].items() if key not in _SERVERS_OWN}
    spec = stored["spec"]
    if stored["kind"] == "Pod":
        spec = {key: value for key, value in spec.items() if key != "nodeName"}
    return {"apiVersion": stored["apiVersion"], "kind": stored["kind"], "metadata": metadata, "spec": spec}


def annotate(
    kubectl: Kubectl, node: str, arguments: Sequence[str], *, version: str, tell: Callable[[str], None]
) -> None:
    """Rewrite records of a node, of which `version` was read; ClusterError (CONFLICT) when somebody else wrote it since.

    Who may not change nodes gets the command for somebody who may.
    """
    try:
        kubectl.run("annotate", "node", node, *arguments, "--overwrite", f"--resource-version={version}")
    except ClusterError as error:
        if error.reason is not Refusal.FORBIDDEN:
            raise
        # Keys of the record are of whoever wrote it: in a shell they must stay one word.
        tell(f"for an admin: kubectl annotate node {shlex.join([node, *arguments])} --overwrite")


def forget(kubectl: Kubectl, namespace: str, keys: Sequence[str]) -> None:
    """Take entries of pods out of the fleet map."""
    patch = json.dumps({"data": dict.fromkeys(keys)})
    where = ("-n", namespace) if namespace else ()
    kubectl.run("patch", "configmap", "robot-fleet-assignments", *where, "--type=merge", "-p", patch)


def _delete(kubectl: Kubectl, obj: Mapping[str, Any], *, limits: Limits, clock: Clock) -> None:
    """Delete a workload and wait until it and its pods are gone: foreground deletion keeps it until they are."""
    kind, name = str(obj["kind"]).lower(), obj["metadata"]["name"]
    kubectl.run("delete", kind, name, "--cascade=foreground", "--ignore-not-found", "--wait=false")

    def gone() -> bool:
        return not kubectl.run("get", kind, name, "--ignore-not-found", "-o", "name").strip()

    if not clock.until(gone, timeout_s=limits.gone_s):
        raise ClusterError(f"{kind} {name} is not gone after {limits.gone_s:g} s", code=Exit.NOT_READY)
