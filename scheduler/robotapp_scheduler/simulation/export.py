"""`python -m robotapp_scheduler export`: what the scheduler reads of a cluster, as a file for `simulate`.

Only what this scheduler looks at is written: of the environment `ROS_DOMAIN_ID` alone, no commands, no annotations of others, so such
a file can be handed on more easily than `kubectl get -o json`, and is a fraction of its size.
"""

import argparse
import asyncio
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from robotapp_client.api.client import ApiClient
from robotapp_client.transport.errors import ClientError, NotFound
from robotapp_client.transport.kubeconfig import default_kubeconfigs, load
from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.api.kept_annotations import BETA_CLASS, BIND_COMPLETED, MIGRATED_PLUGINS, SELECTED_NODE
from robotapp_scheduler.core.dynamic_resources.objects import DeviceClass, ResourceClaim
from robotapp_scheduler.simulation.dump import encode
from robotapp_scheduler.watch.routes import resources

_OURS: Final = "robotics.io"
_OF_VOLUMES: Final = frozenset({BETA_CLASS, BIND_COMPLETED, MIGRATED_PLUGINS, SELECTED_NODE})


def main(argv: Sequence[str]) -> int:
    """0 when written, 2 when the cluster cannot be read."""
    found = _parser().parse_args(argv)
    try:
        content = asyncio.run(_export(found.kubeconfig, found.context))
        if found.output is None:
            sys.stdout.buffer.write(content)
        else:
            found.output.write_bytes(content)
    except (ClientError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    return 0


async def _export(kubeconfig: Path | None, context: str | None) -> bytes:
    files = [kubeconfig] if kubeconfig else default_kubeconfigs()
    endpoint = await asyncio.to_thread(load, files or None, context)
    async with ApiClient(endpoint, user_agent="robotapp-scheduler-export") as client:
        return await export(client)


async def export(client: ApiClient) -> bytes:
    """A dump of everything the scheduler watches. Raises `ClientError`; kinds that are not installed are left out."""
    objects: list[tuple[str, str, Any]] = []
    for resource, as_type in resources().items():
        try:
            listing = await client.list(resource, as_type=as_type)
        except NotFound:
            continue
        objects += ((resource.api_version, resource.kind, shareable(item)) for item in listing.items)
    return encode(objects)


def shareable(item: Any) -> Any:
    """The object with the annotations that rules read: others may hold anything, as the manifest that `kubectl apply` noted. Without
    the text of a pod's status, which kubelets write, and parameters of drivers in claims and device classes.
    """
    found: dict[str, str] = getattr(item.metadata, "annotations", None) or {}
    kept = {key: value for key, value in found.items() if _is_read(key)}
    if len(kept) != len(found):
        item = msgspec.structs.replace(item, metadata=msgspec.structs.replace(item.metadata, annotations=kept))
    if isinstance(item, ResourceClaim | DeviceClass):
        item = _without_parameters(item)
    if isinstance(item, Pod) and item.status.message:
        item = msgspec.structs.replace(item, status=msgspec.structs.replace(item.status, message=""))
    return item


def _without_parameters(item: ResourceClaim | DeviceClass) -> ResourceClaim | DeviceClass:
    if isinstance(item, DeviceClass):
        return msgspec.structs.replace(item, spec=msgspec.structs.replace(item.spec, config=()))
    devices = msgspec.structs.replace(item.spec.devices, config=())
    item = msgspec.structs.replace(item, spec=msgspec.structs.replace(item.spec, devices=devices))
    if item.status.allocation is None:
        return item
    results = msgspec.structs.replace(item.status.allocation.devices, config=())
    allocation = msgspec.structs.replace(item.status.allocation, devices=results)
    status = msgspec.structs.replace(item.status, allocation=allocation, devices=())
    return msgspec.structs.replace(item, status=status)


def _is_read(key: str) -> bool:
    domain = key.partition("/")[0]
    return domain == _OURS or domain.endswith(f".{_OURS}") or key in _OF_VOLUMES


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="robotapp-scheduler export",
        description="Writes what the scheduler reads of a cluster, for `simulate`.",
        epilog="example: robotapp-scheduler export -o cluster.json && robotapp-scheduler simulate cluster.json",
    )
    parser.add_argument("--kubeconfig", type=Path, help="default: $KUBECONFIG, ~/.kube/config, the pod's account")
    parser.add_argument("--context", help="context of the kubeconfig")
    parser.add_argument("-o", "--output", type=Path, help="file to write; default: standard output")
    return parser
