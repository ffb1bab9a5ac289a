"""The settings of Rigel's own orchestration plugin, as far as a RobotApp has a place for them; the rest is noted.

Their meaning is that plugin's: a readiness command, remote nodes, volumes, and `additional_k8s_params`, which is laid over
the Deployment that the plugin would write (lists of named entries by name).
"""

import re
import shlex
from dataclasses import dataclass, field
from typing import Any, Final

from rigel_bridge.document.naming import checked_label
from rigel_bridge.document.section import Section
from rigel_bridge.render.draft import Draft
from rigel_bridge.render.notes import Note

KEYS: Final = (
    *("deployment_name", "readiness", "observability", "observability_only", "rolling_update", "distributed"),
    *("persistent_storage", "results", "additional_k8s_params"),
)
_SIZE: Final = re.compile(r"[1-9][0-9]{0,17}(Ki|Mi|Gi|Ti|Pi|k|M|G|T|P)?")
_REMOTE: Final = {"deploymentType": "remote"}


@dataclass(slots=True)
class Extras:
    """What the settings give apart from fields of the RobotApp."""

    claims: list[dict[str, Any]] = field(default_factory=list)
    """PersistentVolumeClaims, without the app's name and namespace."""
    strategy: dict[str, Any] = field(default_factory=dict)
    """Of a plain Deployment; a RobotApp replaces a pod only when its predecessor is gone."""
    annotations: dict[str, str] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)


def apply(block: Section, draft: Draft, count: int) -> Extras:
    """Fill what the settings give, for the one component of a file; with several, each has its own fields."""
    extras = Extras()
    for key in ("readiness", "persistent_storage", "distributed"):
        if count > 1 and (node := block.get(key)):
            raise node.fail(f"is one, and there are several components: write it under components.<name> ({_OWN[key]})")
    if readiness := block.section("readiness"):
        _readiness(readiness, draft, extras)
    if update := block.section("rolling_update"):
        _rolling_update(update, extras)
    if distributed := block.section("distributed"):
        _distributed(distributed, draft)
    if storage := block.section("persistent_storage"):
        _storage(storage, draft, extras)
    if results := block.section("results"):
        _results(results, extras)
    _observability(block, extras)
    return extras


_OWN: Final = {
    "readiness": "readinessProbe",
    "persistent_storage": "volumeMounts and template.spec.volumes",
    "distributed": "runsOn, or template.spec.nodeSelector",
}


def _readiness(section: Section, draft: Draft, extras: Extras) -> None:
    section.refuse_unknown(("command", "initial_delay_seconds", "period_seconds", "timeout_seconds"))
    node = section.get("command") or section.node
    try:
        command = shlex.split(section.required_text("command"))
    except ValueError as error:
        raise node.fail(str(error)) from error
    probe = {
        "exec": {"command": command},
        "initialDelaySeconds": _count(section, "initial_delay_seconds", 5, least=0),
        "periodSeconds": _count(section, "period_seconds", 5, least=1),
    }
    draft.put(("components", 0, "readinessProbe"), probe, section.node)
    if limit := section.number("timeout_seconds"):
        extras.annotations["wait-seconds"] = str(limit)


def _count(section: Section, key: str, default: int, *, least: int) -> int:
    found = section.number(key)
    if found is not None and not least <= found <= 86_400 and (node := section.get(key)):
        raise node.fail(f"must be from {least} to 86400, found {found}")
    return default if found is None else found


def _rolling_update(section: Section, extras: Extras) -> None:
    section.refuse_unknown(("strategy", "max_surge", "max_unavailable"))
    if section.choice("strategy", ("Rolling", "Recreate")) == "Recreate":
        extras.strategy = {"type": "Recreate"}
        return
    counts = {
        "maxSurge": _count(section, "max_surge", 1, least=0),
        "maxUnavailable": _count(section, "max_unavailable", 0, least=0),
    }
    extras.strategy = {"type": "RollingUpdate", "rollingUpdate": counts}
    extras.notes.append(
        Note(
            f"{section.node.place}: {section.node.path} is not carried over: a RobotApp replaces a pod when its predecessor is "
            "gone, so that there is one publisher at any time; --format pods and manifests keep it",
            plain="",
        )
    )


def _distributed(section: Section, draft: Draft) -> None:
    section.refuse_unknown(("enabled", "default_to_remote", "force_local_flag"))
    remote = section.flag("enabled") and section.flag("default_to_remote") and not section.flag("force_local_flag")
    if remote:
        draft.merge(("components", 0, "template", "spec", "nodeSelector"), dict(_REMOTE), section.node)


def _storage(section: Section, draft: Draft, extras: Extras) -> None:
    section.refuse_unknown(("volumes",))
    volumes, mounts = [], []
    for entry in section.sections("volumes"):
        entry.refuse_unknown(("name", "size", "storage_class", "host_path", "mount_path"))
        name = entry.required_text("name")
        node = entry.get("name") or entry.node
        if checked_label(name, node, longest=58) != name:
            raise node.fail(f"{name[:80]!r} is no name of a volume; allowed: lower-case letters, digits and dashes")
        claim = f"{name}-pvc"
        extras.claims.append(_claim(entry, claim))
        volumes.append({"name": name, "persistentVolumeClaim": {"claimName": claim}})
        mounts.append({"name": name, "mountPath": entry.text("mount_path") or f"/persistent/{name}"})
        if path := entry.get("host_path"):
            extras.notes.append(
                Note(
                    f"{path.place}: {path.path} is not carried over: which folder of a node a volume is, its administrator decides"
                )
            )
    if volumes:
        draft.put(("components", 0, "template", "spec", "volumes"), volumes, section.node)
        draft.put(("components", 0, "volumeMounts"), mounts, section.node)


def _claim(entry: Section, name: str) -> dict[str, Any]:
    size = entry.required_text("size")
    if not _SIZE.fullmatch(size):
        raise (entry.get("size") or entry.node).fail(f"{size[:80]!r} is no size; write for example 1Gi or 500Mi")
    spec: dict[str, Any] = {"accessModes": ["ReadWriteOnce"], "resources": {"requests": {"storage": size}}}
    if chosen := entry.text("storage_class"):
        spec["storageClassName"] = chosen
    return {"apiVersion": "v1", "kind": "PersistentVolumeClaim", "metadata": {"name": name}, "spec": spec}


def _results(section: Section, extras: Extras) -> None:
    section.refuse_unknown(("source_path", "container"))
    path = section.required_text("source_path")
    if not path.startswith("/"):
        raise (section.get("source_path") or section.node).fail(f"{path[:80]!r} must begin with /")
    extras.annotations["results-path"] = path


def _observability(block: Section, extras: Extras) -> None:
    only = block.get("observability_only")
    if only and block.flag("observability_only"):
        raise only.fail(
            "there is no application to deploy; metrics of all apps come with the chart (docs/installation.md), once per cluster"
        )
    section = block.section("observability")
    if section and section.flag("enabled"):
        left = f"{section.node.place}: {section.node.path} is not carried over"
        extras.notes.append(
            Note(
                f"{left}: metrics of all apps come with the chart, once per cluster",
                plain=f"{left}: plain objects have no metrics of their own",
            )
        )
