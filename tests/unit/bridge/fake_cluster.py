"""A kubectl for the bridge's unit tests that works on the store of the fake API server."""

import copy
import json
from collections.abc import Callable, Iterator, MutableMapping
from typing import Any

from tests.support.apiserver import Refused, Store
from tests.support.apiserver.store import Key, key_of
from tests.support.apiserver.verbs import KINDS, Sent, Target, act, target

from rigel_bridge.cluster.kubectl import ClusterError, Kubectl, Refusal
from robotapp_client.api.bodies import APPLY, JSON, JSON_PATCH
from robotapp_client.api.resources import Resource

Json = dict[str, Any]
NAMESPACE = "fleet"
REVISIONS = Resource("apps", "v1", "controllerrevisions", "ControllerRevision", namespaced=True)
_METHODS = {"create": ("POST", JSON), "replace": ("PUT", JSON), "apply": ("PATCH", APPLY)}


def resource_of(kind: str) -> Resource:
    """Returns the resource of RobotApp, robotapps.robotics.io, deployment or of a plural that our clients never read."""
    plural, _, group = kind.partition(".")
    known = (one for one in (*KINDS.values(), REVISIONS) if plural.lower() in (one.plural, one.kind.lower()))
    return next(known, Resource(group, "v1", plural, plural, namespaced=True))


class NamedStore(Store):
    """A store whose uids follow from names, so that tests can write them down."""

    def new_uid(self, name: str) -> str:
        return f"uid-{name}"


class Objects(MutableMapping[tuple[str, str], Json]):
    """The stored objects by plural and name, without copies. One that is set gets what every stored object has."""

    def __init__(self, store: Store) -> None:
        self._store = store

    def __getitem__(self, key: tuple[str, str]) -> Json:
        return self._store.objects[self._key(key)]

    def __setitem__(self, key: tuple[str, str], obj: Json) -> None:
        defaults = {"namespace": NAMESPACE, "uid": self._store.new_uid(key[1]), "resourceVersion": "1", "generation": 1}
        self._store.objects[self._key(key)] = obj | {"metadata": defaults | obj["metadata"]}

    def __delitem__(self, key: tuple[str, str]) -> None:
        del self._store.objects[self._key(key)]

    def __iter__(self) -> Iterator[tuple[str, str]]:
        return iter([(key.collection.rpartition("/")[2], key.name) for key in self._store.objects])

    def __len__(self) -> int:
        return len(self._store.objects)

    @staticmethod
    def _key(key: tuple[str, str]) -> Key:
        return key_of(resource_of(key[0]), key[1], NAMESPACE)


class FakeCluster(Kubectl):
    """Does what kubectl's commands do to `objects`, in one namespace.

    `contents` are the answers to ("logs", pod) and ("exec", pod).
    `refused` maps a verb and a plural to the reason with which it is refused; `calls` are the commands in order.
    """

    def __init__(self) -> None:
        super().__init__("no-such-kubectl")
        self.store = NamedStore()
        self.objects = Objects(self.store)
        self.refused: dict[tuple[str, str], Refusal] = {}
        self.contents: dict[tuple[str, ...], bytes] = {}
        self.calls: list[tuple[str, ...]] = []
        self.before: Callable[[tuple[str, ...]], None] = lambda _: None

    def run(self, *arguments: str, stdin: str = "", timeout_s: float = 0) -> str:  # noqa: ARG002
        self.calls.append(arguments)
        self.before(arguments)
        verb, body = arguments[0], json.loads(stdin) if stdin else {}
        resource = resource_of(body["kind"] if body else arguments[1])
        if reason := self.refused.get((verb, resource.plural)):
            raise ClusterError(f"{verb} {resource.plural} is refused", reason=reason)
        try:
            if body:
                return json.dumps(self._write(verb, resource, body, arguments))
            return self._run_by_name(verb, resource, arguments[2:])
        except Refused as refusal:
            reason = next((known for known in Refusal if known == refusal.reason), Refusal.OTHER)
            raise ClusterError(refusal.message, reason=reason) from refusal

    def binary(self, *arguments: str, limit: int, timeout_s: float = 0) -> bytes:  # noqa: ARG002
        self.calls.append(arguments)
        self.before(arguments)
        if arguments[:2] not in self.contents:
            raise ClusterError(f"{arguments[0]} {arguments[1]} is refused", reason=Refusal.OTHER)
        return self.contents[arguments[:2]]

    def revisions(self) -> list[Json]:
        return self.store.all(REVISIONS)

    def _run_by_name(self, verb: str, resource: Resource, rest: tuple[str, ...]) -> str:
        match verb:
            case "get" if rest[0].startswith("-"):
                return json.dumps(self._list(resource, rest))
            case "get":
                if "--ignore-not-found" in rest and (resource.plural, rest[0]) not in self.objects:
                    return ""
                return json.dumps(act(self.store, _address(resource, rest[0]), Sent("GET")))
            case "patch":
                at = rest.index("-p")
                self._patch_each(resource, [word for word in rest[:at] if not word.startswith("-")], rest[at + 1])
            case "delete":
                for name in (word for word in rest if not word.startswith("-")):
                    self.objects.pop((resource.plural, name), None)
        return ""

    def _list(self, resource: Resource, rest: tuple[str, ...]) -> Json:
        fields = next((word.partition("=")[2] for word in rest if word.startswith("--field-selector=")), "")
        labels = rest[rest.index("-l") + 1] if "-l" in rest else ""
        query = {"labelSelector": labels, "fieldSelector": fields}
        return act(self.store, _address(resource), Sent("GET", query=query))

    def _patch_each(self, resource: Resource, names: list[str], patch: str) -> None:
        """As kubectl does it, the others are patched when one is refused."""
        refused = []
        for name in names:
            try:
                act(self.store, _address(resource, name), Sent("PATCH", patch.encode(), JSON_PATCH))
            except Refused:
                refused.append(name)
        if refused:
            raise Refused(422, "Invalid", f"{refused} is refused")

    def _write(self, verb: str, resource: Resource, body: Json, arguments: tuple[str, ...]) -> Json:
        method, content_type = _METHODS[verb]
        name = "" if verb == "create" else body["metadata"]["name"]
        manager = next((word.partition("=")[2] for word in arguments if word.startswith("--field-manager=")), "kubectl")
        sent = Sent(method, json.dumps(body).encode(), content_type, {"fieldManager": manager, "force": "true"})
        store = copy.deepcopy(self.store) if "--dry-run=server" in arguments else self.store
        return act(store, _address(resource, name), sent)


def app(name: str = "teleop", **spec: Any) -> Json:
    """A RobotApp as the bridge renders it."""
    return {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "RobotApp",
        "metadata": {"name": name, "annotations": {"rigel.robotics.io/bridge-version": "1"}},
        "spec": {"ros": {"distro": "humble"}, **spec},
    }


def _address(resource: Resource, name: str = "") -> Target:
    return target(resource.path(NAMESPACE if resource.namespaced else None, name or None))
