"""`simulate`: where pods would go, under the running configuration or another one, without placing anything.

The scheduler says which resources decide; they are read with the user's own rights, thinned out, and sent to it with the
files' objects added. It places them on paper, in a process beside the one that places pods.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from robotapp_api.model.names import SYSTEM_NAMESPACE
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.output import Column, blank_line, print_line, print_table, write_structured
from robotapp_cli.reading.fields import Json
from robotapp_cli.reading.files import documents, objects
from robotapp_cli.reading.scheduler_link import Link, NoAnswerError, connect
from robotapp_cli.reading.session import Session
from robotapp_client.api.resources import Resource
from robotapp_client.transport.errors import Forbidden, NotFound

_MOST_BYTES: Final = 64 << 20
_PRIVATE: Final = ("env", "envFrom", "command", "args", "lifecycle")
"""What no rule reads of a container, and may be secret."""
_CONTAINERS: Final = ("containers", "initContainers", "ephemeralContainers")
_OF_A_COMPONENT: Final = frozenset(
    {
        "name",
        "runsOn",
        "qosClass",
        "policies",
        "devices",
        "requires",
        "sharedData",
        "colocateWith",
        "separateFrom",
        "dependsOn",
        "replicas",
        "replicaIdentity",
        "job",
        "schedule",
        "onDisconnect",
    }
)
"""What rules read of a RobotApp's component."""
_APPLIED: Final = "kubectl.kubernetes.io/last-applied-configuration"
_OWNERS: Final = frozenset(
    {"RobotApp", "Deployment", "ReplicaSet", "StatefulSet", "DaemonSet", "ReplicationController", "Job", "CronJob"}
)
"""Kinds that become pods and may be taken for them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """What the user wants simulated."""

    files: Sequence[Path] = ()
    offline: bool = False
    config: Path | None = None
    replay: int = 0
    scheduler_url: str | None = None
    scheduler_namespace: str = SYSTEM_NAMESPACE


async def show_simulation(session: Session, wish: Wish) -> None:
    """Print what would become of the waiting pods of the cluster and of the files."""
    extra = [obj for path in wish.files for obj in objects_of(path, namespace=session.home)]
    body: Json = {"apiVersion": "v1", "kind": "List"}
    if wish.config is not None:
        body["config"] = document(wish.config)
    async with connect(session, url=wish.scheduler_url, namespace=wish.scheduler_namespace) as link:
        try:
            items = [] if wish.offline else await _cluster(session, link)
            body["items"] = [*items, *extra]
            content = json.dumps(body, separators=(",", ":")).encode()
            if len(content) > _MOST_BYTES:
                raise CliError(
                    f"the cluster is {len(content) >> 20} MiB of JSON, the scheduler takes {_MOST_BYTES >> 20}\n"
                    "Use: python -m robotapp_scheduler export -o cluster.json && python -m robotapp_scheduler simulate cluster.json"
                )
            found = await link.post(f"/simulate?replay={wish.replay}", content)
        except NoAnswerError as error:
            raise CliError(f"nothing was simulated: {error}") from error
    if session.options.output.structured:
        write_structured(found, session.options.output)
    else:
        _print(found, extra)


async def _cluster(session: Session, link: Link) -> list[Json]:
    """Everything that decides, as the scheduler names it."""
    wanted = await link.get("/simulate")
    found: list[Json] = []
    for each in wanted["resources"]:
        resource = Resource(each["group"], each["version"], each["plural"], each["kind"], namespaced=each["namespaced"])
        try:
            listing = await session.client.list(resource)
        except NotFound:
            continue  # not installed here
        except Forbidden as error:
            raise CliError(
                f"you may not do this: {error.message}\nsimulate reads {len(wanted['resources'])} kinds of the whole cluster "
                "with your rights. Ask for a ClusterRoleBinding of the role in docs/simulate.md, section Rights."
            ) from error
        found += [{"kind": resource.kind, **thinned(item)} for item in listing.items]
    return found


def thinned(obj: Json) -> Json:
    """Without what no rule reads: a third of the size, and no secrets from environments, of templates or of what was applied."""
    metadata, spec = obj.get("metadata"), obj.get("spec")
    if isinstance(metadata, dict):
        metadata.pop("managedFields", None)
        if isinstance(annotations := metadata.get("annotations"), dict):
            annotations.pop(_APPLIED, None)
    if isinstance(spec, dict):
        spec.pop("template", None)
        for container in (item for key in _CONTAINERS for item in _objects(spec.get(key))):
            for name in _PRIVATE:
                container.pop(name, None)
            if mounts := _deciding_mounts(container.pop("volumeMounts", None)):
                container["volumeMounts"] = mounts
        for component in _objects(spec.get("components")):
            for name in component.keys() - _OF_A_COMPONENT:
                del component[name]
    return obj


def _deciding_mounts(mounts: object) -> list[Json]:
    """Of mounts the options that not every node's runtime has."""
    option = "bindMountOptions"
    return [{option: mount[option]} for mount in _objects(mounts) if mount.get(option)]


def _objects(items: object) -> list[Json]:
    """Those of a list that are objects: files hold anything."""
    return [item for item in items if isinstance(item, dict)] if isinstance(items, list) else []


def objects_of(path: Path, *, namespace: str) -> Iterator[Json]:
    """The objects of a YAML or JSON file, lists taken apart; - is standard input."""
    for obj in objects(path, most_bytes=_MOST_BYTES):
        if not isinstance(obj.get("metadata"), dict):
            raise CliError(f"{path}: holds something that is no Kubernetes object", code=Exit.USAGE)
        if obj.get("kind") == "Pod":
            obj["metadata"].setdefault("namespace", namespace)
        yield thinned(obj)


def document(path: Path) -> Any:
    """The one document of a file."""
    found = documents(path, most_bytes=_MOST_BYTES)
    if len(found) != 1:
        raise CliError(f"{path}: holds {len(found)} documents, one is needed", code=Exit.USAGE)
    if not isinstance(found[0], dict):
        raise CliError(f"{path}: holds something that is no Kubernetes object", code=Exit.USAGE)
    return found[0]


def _print(found: Json, extra: Sequence[Json]) -> None:
    again = any(each["was"] for each in found["placements"])
    if found["placements"]:
        _print_placements(found["placements"], again=again)
    else:
        print_line("No pod waits for this scheduler.")
    blank_line()
    total = found["placed"] + found["refused"]
    lines = [f"{found['placed']} of {total} pods placed on {found['nodes']} nodes, configuration {found['config']}"]
    if again:
        lines.append(f"{found['moved']} pods placed again would be elsewhere")
    lines += [f"{count} pods wait for scheduler {name}" for name, count in found["otherSchedulers"].items()]
    for line in [*lines, *_tell_left_out(extra), *found["problems"], found["note"]]:
        print_line(line)


def _tell_left_out(extra: Sequence[Json]) -> Iterator[str]:
    """Says which objects of the user's files were not placed although pods come of them, and what places them."""
    for obj in extra:
        kind, name = str(obj.get("kind")), obj["metadata"].get("name", "")
        if kind == "RobotApp":
            yield f"RobotApp {name} of the files was left out: kubectl robotapp what-if --app FILE says where its pods would go"
        elif kind in _OWNERS:
            yield f"{kind} {name} of the files was left out, since only a cluster makes pods of it: put its pods into a file"


def _print_placements(placements: Sequence[Json], *, again: bool) -> None:
    columns = [Column("NAMESPACE"), Column("POD"), Column("NODE"), *([Column("WAS")] if again else [])]
    rows = []
    for each in placements:
        many = each["feasible"]
        why = each["message"] or (
            f"best of {many} feasible nodes, score {each['score']}" if many > 1 else "the only feasible node"
        )
        rows.append([each["namespace"], each["name"], each["node"] or "-", *([each["was"]] if again else []), why])
    print_table([*columns, Column("WHY", wraps=True)], rows)
