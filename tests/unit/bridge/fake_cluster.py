"""A cluster for the bridge's unit tests: what kubectl would read and write, kept in memory."""

import copy
import json
from collections.abc import Callable
from typing import Any

from rigel_bridge.cluster.kubectl import ClusterError, Kubectl, Refusal

Json = dict[str, Any]


class FakeCluster(Kubectl):
    """Stores objects by (kind, name). An apply merges like the server's: fields of the last apply go, others' stay.

    `contents` are the answers to ("logs", pod) and ("exec", pod).
    `refused` maps a verb and kind to the reason with which it is refused; `calls` are the commands in order.
    """

    def __init__(self) -> None:
        super().__init__("no-such-kubectl")
        self.objects: dict[tuple[str, str], Json] = {}
        self.refused: dict[tuple[str, str], Refusal] = {}
        self.contents: dict[tuple[str, ...], bytes] = {}
        self.calls: list[tuple[str, ...]] = []
        self.before: Callable[[tuple[str, ...]], None] = lambda _: None
        self._applied: dict[str, Json] = {}
        self._writes = 0

    def run(self, *arguments: str, stdin: str = "", timeout_s: float = 0) -> str:  # noqa: ARG002
        self.calls.append(arguments)
        self.before(arguments)
        verb, body = arguments[0], json.loads(stdin) if stdin else {}
        kind = _kind(str(body["kind"]) if body else arguments[1])
        if reason := self.refused.get((verb, kind)):
            raise ClusterError(f"{verb} {kind} is refused", reason=reason)
        if verb == "get":
            found = self._get(kind, arguments[2:])
            return json.dumps(found) if found else ""
        if verb == "annotate":
            return ""
        if verb == "patch":
            return self._patched(kind, arguments)
        if verb == "delete":
            for name in (name for name in arguments[2:] if not name.startswith("-")):
                self.objects.pop((kind, name), None)
            return ""
        return json.dumps(self._write(verb, kind, body, dry_run="--dry-run=server" in arguments))

    def binary(self, *arguments: str, limit: int, timeout_s: float = 0) -> bytes:  # noqa: ARG002
        self.calls.append(arguments)
        self.before(arguments)
        if arguments[:2] not in self.contents:
            raise ClusterError(f"{arguments[0]} {arguments[1]} is refused", reason=Refusal.OTHER)
        return self.contents[arguments[:2]]

    def revisions(self) -> list[Json]:
        return [each for (kind, _), each in self.objects.items() if kind == "controllerrevisions"]

    def _get(self, kind: str, rest: tuple[str, ...]) -> Json:
        if rest[0] != "-l":
            found = self.objects.get((kind, rest[0]))
            if "--ignore-not-found" in rest and found is None:
                return {}
            if rest[0].startswith("-"):
                return {"items": [each for (other, _), each in self.objects.items() if other == kind]}
            if found is None:
                raise ClusterError(f"{kind} {rest[0]} not found", reason=Refusal.NOT_FOUND)
            return found
        key, _, value = rest[1].partition("=")
        listed = [each for (other, _), each in self.objects.items() if other == kind]
        return {"items": [each for each in listed if each["metadata"].get("labels", {}).get(key) == value]}

    def _patched(self, kind: str, arguments: tuple[str, ...]) -> str:
        """JSON patches of annotations: test, add, remove. As kubectl does it, the others are patched when one fails."""
        names = [each for each in arguments[2 : arguments.index("-p")] if not each.startswith("-")]
        refused = []
        for name in names:
            stored = self.objects.get((kind, name), {})
            annotations = stored.get("metadata", {}).setdefault("annotations", {}) if stored else {}
            for each in json.loads(arguments[arguments.index("-p") + 1]):
                key = each["path"].removeprefix("/metadata/annotations/").replace("~1", "/")
                if each["op"] != "add" and (
                    key not in annotations or annotations[key] != each.get("value", annotations[key])
                ):
                    refused.append(name)
                    break
                if each["op"] == "add":
                    annotations[key] = each["value"]
                elif each["op"] == "remove":
                    del annotations[key]
        if refused:
            raise ClusterError(f"{refused} is refused", reason=Refusal.INVALID)
        return ""

    def _write(self, verb: str, kind: str, body: Json, *, dry_run: bool) -> Json:
        name = body["metadata"]["name"]
        present = self.objects.get((kind, name))
        if verb == "create" and present:
            raise ClusterError(f"{name} exists", reason=Refusal.EXISTS)
        stored = copy.deepcopy(body)
        if verb == "apply":
            others = {k: v for k, v in (present or {}).get("spec", {}).items() if k not in self._applied.get(name, {})}
            stored["spec"] = {**others, **body["spec"]}
        stored["metadata"] = {**(present or {}).get("metadata", {}), **stored["metadata"]}
        stored["metadata"].setdefault("namespace", "fleet")
        stored["metadata"].setdefault("uid", f"uid-{name}")
        if (
            verb == "replace"
            and present
            and present["metadata"].get("resourceVersion") != body["metadata"].get("resourceVersion")
        ):
            raise ClusterError(f"{name} was modified", reason=Refusal.CONFLICT)
        changed = present is None or present["spec" if "spec" in stored else "data"] != stored.get(
            "spec", stored.get("data")
        )
        stored["metadata"]["generation"] = stored["metadata"].get("generation", 0) + changed
        if not dry_run:
            self._writes += changed
            self.objects[kind, name] = stored
            if verb == "apply":
                self._applied[name] = copy.deepcopy(body["spec"])
        return stored


def app(name: str = "teleop", **spec: Any) -> Json:
    """A RobotApp as the bridge renders it."""
    return {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "RobotApp",
        "metadata": {"name": name, "annotations": {"rigel.robotics.io/bridge-version": "1"}},
        "spec": {"ros": {"distro": "humble"}, **spec},
    }


def _kind(text: str) -> str:
    """`robotapps` of RobotApp and robotapps.robotics.io."""
    known = {
        "RobotApp": "robotapps",
        "ControllerRevision": "controllerrevisions",
        "Deployment": "deployments",
        "PersistentVolumeClaim": "persistentvolumeclaims",
        "Pod": "pods",
        "pod": "pods",
        "deployment": "deployments",
    }
    return known.get(text, text.partition(".")[0])
