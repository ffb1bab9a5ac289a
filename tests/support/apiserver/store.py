"""Objects with one global, growing resourceVersion and a history that can be compacted: etcd in miniature."""

import itertools
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, NamedTuple, TypeVar, cast

from tests.support.apiserver import owners
from tests.support.apiserver.owners import Owned, Owner

from robotapp_client.api.resources import Resource

NOBODY = Owner("", "Update")
"""Who writes as an administrator, and leaves no record."""
Json = dict[str, Any]
T = TypeVar("T")


class Refused(Exception):  # noqa: N818 - an answer, not a bug
    """An error answer."""

    def __init__(self, code: int, reason: str, message: str, *, field: str = "", owned: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.code = code
        self.reason = reason
        self.message = message
        self.field = field
        self.owned = owned
        """Fields of others that a server-side apply would have changed."""

    def status(self) -> Json:
        """The Status object of the answer."""
        named = {"code": self.code, "reason": self.reason, "message": self.message}
        cause = {"field": self.field, "reason": "FieldValueInvalid", "message": self.message}
        causes = [cause] if self.field else []
        causes += [{"field": field, "reason": "FieldManagerConflict", "message": self.message} for field in self.owned]
        details = {"details": {"causes": causes}} if causes else {}
        return {"kind": "Status", "apiVersion": "v1", "metadata": {}, "status": "Failure", **named, **details}


class Key(NamedTuple):
    """Collection ("apps/deployments", "/pods"), namespace ("" when cluster-scoped) and name."""

    collection: str
    namespace: str
    name: str


def key_of(resource: Resource, name: str, namespace: str | None = None) -> Key:
    return Key(f"{resource.group}/{resource.plural}", (namespace or "") if resource.namespaced else "", name)


class Step(NamedTuple):
    """One change: `old` None for a creation, `new` None for a deletion (then `last` is the final state)."""

    version: int
    key: Key
    old: Json | None
    new: Json | None
    last: Json


class Snapshot(NamedTuple):
    """A state of the store to which it can go back."""

    version: int
    objects: dict[Key, Json]
    owned: dict[Key, Owned]


@dataclass(slots=True)
class Store:
    """`watchers` are called synchronously after each change. `owned`: who wrote which field last."""

    version: int = 1
    floor: int = 0
    objects: dict[Key, Json] = field(default_factory=dict)
    owned: dict[Key, Owned] = field(default_factory=dict)
    history: list[Step] = field(default_factory=list)
    watchers: list[Callable[[Step], None]] = field(default_factory=list)
    pages: dict[str, tuple[int, list[Json]]] = field(default_factory=dict)
    """Rest of each list that was read in part: continue token -> version of the list, its other items."""
    _uids: Iterator[int] = field(default_factory=itertools.count)

    def compact(self) -> None:
        """Forget the history: every watch that has to resume gets 410 from now on."""
        self.floor = self.version
        self.history.clear()

    def snapshot(self) -> "Snapshot":
        """What a backup of etcd holds."""
        return Snapshot(self.version, {key: clone(obj) for key, obj in self.objects.items()}, dict(self.owned))

    def restore(self, snapshot: "Snapshot", *, bump: int = 0) -> None:
        """Goes back to `snapshot`, its version included, as etcd does; uids that were given since are not given again.

        With `bump` the version is that much higher and what was before is compacted: `--bump-revision --mark-compacted`.
        """
        self.version = self.floor = snapshot.version + bump
        self.objects = {key: clone(obj) for key, obj in snapshot.objects.items()}
        self.owned = dict(snapshot.owned)
        self.history.clear()
        self.pages.clear()

    def since(self, version: int) -> list[Step]:
        if version < self.floor:
            raise Refused(410, "Expired", f"too old resource version: {version} ({self.floor})")
        return [step for step in self.history if step.version > version]

    def get(self, key: Key) -> Json:
        try:
            return clone(self.objects[key])
        except KeyError:
            plural = key.collection.rpartition("/")[2]
            raise Refused(404, "NotFound", f'{plural} "{key.name}" not found') from None

    # Objects by their resource, for tests: as an administrator with all rights, and without copies

    def find(self, resource: Resource, name: str, namespace: str | None = None) -> Json | None:
        return self.objects.get(key_of(resource, name, namespace))

    def all(self, resource: Resource) -> list[Json]:
        """Returns the stored objects of a kind in the order of their names."""
        collection = f"{resource.group}/{resource.plural}"
        chosen = [(key, obj) for key, obj in self.objects.items() if key.collection == collection]
        return [obj for _, obj in sorted(chosen, key=lambda pair: pair[0])]

    def put(self, resource: Resource, obj: Json, *, uid: str = "") -> Json:
        """Creates or overwrites an object, status included, and returns a copy of it."""
        obj = clone(obj)
        meta = obj.setdefault("metadata", {})
        key = key_of(resource, meta["name"], meta.get("namespace"))
        old = self.objects.get(key)
        meta["uid"] = uid or (old["metadata"]["uid"] if old else self.new_uid(key.name))
        return self._commit(key, old, obj)

    def remove(self, resource: Resource, name: str, namespace: str | None = None) -> None:
        key = key_of(resource, name, namespace)
        self._remove(key, clone(self.objects[key]))

    # What requests do

    def select(
        self, collection: str, namespace: str | None, match: Callable[[Json], bool] = lambda _: True
    ) -> list[Json]:
        chosen = [
            (key, obj)
            for key, obj in self.objects.items()
            if key.collection == collection and namespace in (None, key.namespace) and match(obj)
        ]
        return [clone(obj) for _, obj in sorted(chosen, key=lambda pair: pair[0])]

    def create(self, key: Key, obj: Json, *, writer: Owner = NOBODY) -> Json:
        if key in self.objects:
            plural = key.collection.rpartition("/")[2]
            raise Refused(409, "AlreadyExists", f'{plural} "{key.name}" already exists')
        obj = clone(obj)
        meta = obj.setdefault("metadata", {})
        meta.pop("resourceVersion", None)
        meta |= {"name": key.name, "uid": self.new_uid(key.name), "generation": 1}
        meta["creationTimestamp"] = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        if key.namespace:
            meta["namespace"] = key.namespace
        self._record(key, obj, owners.written({}, writer, {}, obj))
        return self._commit(key, None, obj)

    def update(
        self, key: Key, obj: Json, *, subresource: str = "", writer: Owner = NOBODY, owned: Owned | None = None
    ) -> Json:
        """Replace; a resourceVersion or uid in `obj` is a precondition. No change, no new version.

        `owned`: whose the fields are then, where it is known already.
        """
        old = self.get(key)
        check(old, obj.get("metadata") or {})
        new = clone(obj)
        if subresource == "status":
            meta = clone(old["metadata"])
            if key.collection == "/pods":  # as the real one: these two go along with a pod's status
                meta |= {
                    name: new["metadata"].get(name) for name in ("annotations", "labels") if name in new["metadata"]
                }
            new = {**clone(old), "metadata": meta, "status": new.get("status")}
        elif "status" in old:
            new["status"] = old["status"]
        meta = new.setdefault("metadata", {})
        for own in ("name", "namespace", "uid", "creationTimestamp", "deletionTimestamp", "generation"):
            if own in old["metadata"]:
                meta[own] = old["metadata"][own]
        meta["resourceVersion"] = old["metadata"]["resourceVersion"]
        entries, before = meta.pop("managedFields", None), self.owned.get(key, {})
        if owned is None and entries and entries != old["metadata"].get("managedFields"):
            owned = owners.renamed(before, entries)
        self._record(key, new, owners.written(before, writer, old, new) if owned is None else owned)
        if new == old:
            return old
        if new.get("spec") != old.get("spec"):
            meta["generation"] = old["metadata"].get("generation", 1) + 1
        if meta.get("deletionTimestamp") and not meta.get("finalizers"):
            return self._remove(key, new)
        return self._commit(key, old, new)

    def delete(self, key: Key, preconditions: Json, *, graceful: bool = False) -> Json:
        """With finalizers, or gracefully, the object only says that it is being deleted."""
        obj = self.get(key)
        check(obj, preconditions)
        if graceful or obj["metadata"].get("finalizers"):
            if "deletionTimestamp" not in obj["metadata"]:
                old = clone(obj)
                obj["metadata"]["deletionTimestamp"] = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
                return self._commit(key, old, obj)
            return obj
        return self._remove(key, obj)

    def overwrite(self, key: Key, new: Json) -> Json:
        """All of the object in one step, status included: what only the server itself does."""
        return self._commit(key, self.get(key), clone(new))

    def new_uid(self, name: str) -> str:  # noqa: ARG002 - some stores name it after the object
        return str(uuid.UUID(int=next(self._uids) + 2**80))

    def _record(self, key: Key, obj: Json, owned: Owned) -> None:
        self.owned[key] = owned
        if owned:
            obj["metadata"]["managedFields"] = owners.records(owned)

    def _commit(self, key: Key, old: Json | None, new: Json) -> Json:
        self.version += 1
        new["metadata"]["resourceVersion"] = str(self.version)
        self.objects[key] = new
        shown = clone(new)
        self._tell(Step(self.version, key, old, shown, shown))
        return clone(new)

    def _remove(self, key: Key, last: Json) -> Json:
        self.version += 1
        old = self.objects.pop(key)
        self.owned.pop(key, None)
        last["metadata"]["resourceVersion"] = str(self.version)
        self._tell(Step(self.version, key, clone(old), None, last))
        return last

    def _tell(self, step: Step) -> None:
        self.history.append(step)
        for watcher in list(self.watchers):
            watcher(step)


def clone(value: T) -> T:
    """Returns a deep copy of JSON, much faster than copy.deepcopy."""
    copied: Any = value
    if isinstance(value, dict):
        copied = {key: clone(item) for key, item in value.items()}
    elif isinstance(value, list):
        copied = [clone(item) for item in value]
    return cast(T, copied)


def check(obj: Json, wanted: Json) -> None:
    """uid and resourceVersion preconditions; empty ones are none."""
    for name in ("uid", "resourceVersion"):
        have, want = obj["metadata"][name], wanted.get(name)
        if want and want != have:
            raise Refused(409, "Conflict", f"the {name} in the precondition ({want}) does not match {have}")


def merge(target: Any, patch: Any) -> Any:
    """RFC 7386."""
    if not isinstance(patch, dict):
        return clone(patch)
    merged = dict(target) if isinstance(target, dict) else {}
    for key, value in patch.items():
        if value is None:
            merged.pop(key, None)
        else:
            merged[key] = merge(merged.get(key), value)
    return merged
