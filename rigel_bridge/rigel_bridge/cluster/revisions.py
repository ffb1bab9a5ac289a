"""Past specs of a RobotApp as ControllerRevisions, as Deployments and StatefulSets keep theirs. Pure.

They belong to the app: the garbage collector takes them with it. The newest one holds the spec of the last write.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from rigel_bridge.names import API_VERSION, APP_LABEL, APP_UID_LABEL, PROVENANCE, RUN_RENEWED

MOST: Final = 10
"""Past specs of one app, the present one among them."""


@dataclass(frozen=True, slots=True)
class Revision:
    """One stored spec. `number` grows with each write; `created` is the API server's text."""

    number: int
    name: str
    spec: Mapping[str, Any]
    created: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Recording:
    """What to delete, then what to create, so that the newest revision holds a spec; nothing when it does already."""

    delete: tuple[str, ...] = ()
    create: dict[str, Any] | None = None


def same(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether two specs are byte for byte the same, as the API server writes them: 1 and 1.0 and true are three values."""
    return canonical(one) == canonical(other)


def canonical(spec: Mapping[str, Any]) -> str:
    return json.dumps(spec, sort_keys=True, separators=(",", ":"))


def belonging(items: Sequence[Mapping[str, Any]], app: Mapping[str, Any]) -> list[Revision]:
    """The app's own revisions among what its label finds, oldest first. One that holds no spec is passed over."""
    found = []
    for item in items:
        metadata, data = item["metadata"], item.get("data")
        owners = [owner.get("uid") for owner in metadata.get("ownerReferences", ()) if owner.get("controller")]
        spec = data.get("spec") if isinstance(data, Mapping) else None
        if owners == [app["metadata"]["uid"]] and isinstance(spec, Mapping):
            found.append(
                Revision(
                    number=int(item.get("revision", 0)),
                    name=metadata["name"],
                    spec=spec,
                    created=metadata.get("creationTimestamp", ""),
                    provenance=provenance(item),
                )
            )
    return sorted(found, key=lambda revision: revision.number)


def provenance(obj: Mapping[str, Any]) -> dict[str, str]:
    """The bridge's own annotations of an object, but for the one that changes while a run lives."""
    annotations = obj["metadata"].get("annotations") or {}
    return {key: value for key, value in annotations.items() if key.startswith(PROVENANCE) and key != RUN_RENEWED}


def recording(items: Sequence[Mapping[str, Any]], app: Mapping[str, Any]) -> Recording:
    """How the spec of a stored app becomes the newest revision. An older equal one gives way to it, as do the oldest of too many."""
    present = belonging(items, app)
    if present and same(present[-1].spec, app["spec"]):
        return Recording()
    kept = [revision for revision in present if not same(revision.spec, app["spec"])]
    surplus = max(0, len(kept) - (MOST - 1))
    leaving = [revision.name for revision in present if revision not in kept[surplus:]]
    # Objects of a deleted app of the same name may still be there: their numbers are taken as well.
    number = 1 + max((int(item.get("revision", 0)) for item in items), default=0)
    return Recording(tuple(leaving), _body(app, number))


def _body(app: Mapping[str, Any], number: int) -> dict[str, Any]:
    metadata = app["metadata"]
    owner = {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "name": metadata["name"],
        "uid": metadata["uid"],
        "controller": True,
    }
    return {
        "apiVersion": "apps/v1",
        "kind": "ControllerRevision",
        "metadata": {
            "name": f"{metadata['name']}-{number}",
            "namespace": metadata["namespace"],
            "labels": {APP_LABEL: metadata["name"], APP_UID_LABEL: metadata["uid"]},
            "annotations": provenance(app),
            "ownerReferences": [owner],
        },
        "revision": number,
        "data": {"spec": app["spec"]},
    }


def target(history: Sequence[Revision], spec: Mapping[str, Any], number: int | None) -> Revision | str:
    """The revision to go back to: the given one, else the newest that differs from the present spec; or why there is none."""
    known = ", ".join(str(revision.number) for revision in history) or "none"
    if number is not None:
        found = next((revision for revision in history if revision.number == number), None)
        return found or f"there is no revision {number}; stored are: {known}"
    earlier = next((revision for revision in reversed(history) if not same(revision.spec, spec)), None)
    return earlier or f"there is no earlier spec to go back to; stored are: {known}"
