"""RobotApps in the cluster: read, write by server-side apply, replace, delete."""

import json
from collections.abc import Mapping
from typing import Any, Final

from rigel_bridge.cluster.kubectl import ClusterError, Kubectl, Refusal
from rigel_bridge.document.failures import Exit
from rigel_bridge.names import APPS, MANAGER

Json = dict[str, Any]
_APPLY: Final = ("apply", "--server-side", "--force-conflicts", f"--field-manager={MANAGER}", "--validate=strict")

_ATTEMPTS: Final = 10


def read(kubectl: Kubectl, name: str) -> Json | None:
    """The stored RobotApp; None when there is none of that name."""
    try:
        return _checked(kubectl.json("get", APPS, name))
    except ClusterError as error:
        if error.reason is Refusal.NOT_FOUND:
            return None
        raise


def existing(kubectl: Kubectl, name: str) -> Json:
    """The stored RobotApp; ClusterError with exit code MISSING when there is none."""
    found = read(kubectl, name)
    if found is None:
        raise ClusterError(
            f"there is no RobotApp {name} in this namespace; `kubectl get robotapps -A` lists all that you may see",
            reason=Refusal.NOT_FOUND,
            code=Exit.MISSING,
        )
    return found


def apply(kubectl: Kubectl, app: Mapping[str, Any], *, dry_run: bool = False) -> Json:
    """Write the fields of `app` and take back those an earlier apply wrote and this one does not; gives the stored object.

    Fields that others wrote and `app` does not name (`suspend`, set by an operator to stop the robots) stay as they are.
    """
    extra = ["--dry-run=server"] if dry_run else []
    return _checked(kubectl.json(*_APPLY, *extra, "-f", "-", stdin=json.dumps(app)), stored=not dry_run)


def replace_spec(kubectl: Kubectl, stored: Mapping[str, Any], spec: Mapping[str, Any]) -> Json:
    """Make the spec exactly this one, also the fields that other managers own. Refused when another writer changed the spec meanwhile.

    The operator writes its status at any time, and a replacement names one version of the whole object: it is tried again.
    """
    present = dict(stored)
    for _ in range(_ATTEMPTS):
        body = {**present, "spec": spec}
        try:
            return _checked(kubectl.json("replace", f"--field-manager={MANAGER}", "-f", "-", stdin=json.dumps(body)))
        except ClusterError as error:
            if error.reason is not Refusal.CONFLICT:
                raise
        present = existing(kubectl, present["metadata"]["name"])
        if present["metadata"]["generation"] != stored["metadata"]["generation"]:
            break
    raise ClusterError(
        f"RobotApp {stored['metadata']['name']} is being changed by somebody else; look at `diff` and try again",
        reason=Refusal.CONFLICT,
    )


def bare(stored: Mapping[str, Any], spec: Mapping[str, Any], annotations: Mapping[str, str]) -> Json:
    """A RobotApp to apply under the name of a stored one."""
    metadata = {key: stored["metadata"][key] for key in ("name", "namespace")}
    return {
        "apiVersion": stored["apiVersion"],
        "kind": stored["kind"],
        "metadata": {**metadata, "annotations": dict(annotations)},
        "spec": dict(spec),
    }


def _checked(found: Json, *, stored: bool = True) -> Json:
    """What every RobotApp has, and every stored one, so that nothing behind this needs to look."""
    metadata, spec = found.get("metadata"), found.get("spec")
    kinds = {"name": str, "namespace": str, "uid": str, "generation": int}
    if not isinstance(metadata, dict) or not isinstance(spec, dict):
        raise ClusterError("wrote no RobotApp: is --kubectl a kubectl?")
    lacking = [key for key, kind in kinds.items() if not isinstance(metadata.get(key), kind)]
    if stored and lacking:
        raise ClusterError(f"wrote a RobotApp without {', '.join(lacking)}: is --kubectl a kubectl?")
    return found
