"""The way to the scheduler's port from a user's machine: kubectl port-forward to the pod that leads.

The API server's own pod proxy would do, were it not that it drops the Authorization header the scheduler asks for.
"""

import contextlib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, Final

from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import LEASES, PODS
from robotapp_client.tools.port_forward import ForwardError, forward_port
from robotapp_client.transport.errors import ApiError

_SELECTOR: Final = "app.kubernetes.io/component=scheduler"
_RELEASE: Final = "app.kubernetes.io/instance"
_LEASE: Final = "robotapp-scheduler"
_PORT: Final = 10259
_PATIENCE_S: Final = 5.0
Pod = dict[str, Any]


class NoTunnelError(Exception):
    """There is no way to the scheduler's pod; the text says why and what helps."""


@contextlib.asynccontextmanager
async def open_tunnel(
    client: ApiClient, namespace: str, *, kubeconfig: Path | None, context: str | None
) -> AsyncIterator[int]:
    """Gives a port of this machine that leads to the scheduler in the namespace. Raises NoTunnelError."""
    pod, port = await find_scheduler_pod(client, namespace)
    way = forward_port(namespace, pod, port, kubeconfig=kubeconfig, context=context, patience_s=_PATIENCE_S)
    async with contextlib.AsyncExitStack() as stack:
        try:
            forward = await stack.enter_async_context(way)
        except ForwardError as error:
            raise NoTunnelError(f"{error}{_name_role(error.refusal)}") from error
        yield forward.port


async def find_scheduler_pod(client: ApiClient, namespace: str) -> tuple[str, int]:
    """Returns the leading scheduler pod and its port. The user's token goes there, so it must be the one it says it is.

    Raises NoTunnelError.
    """
    try:
        pods = (await client.list(PODS, namespace=namespace, label_selector=_SELECTOR)).items
    except ApiError as error:
        raise NoTunnelError(f"{error.message}{_name_role(error.message)}") from error
    running_pods = [pod for pod in pods if (pod.get("status") or {}).get("phase") == "Running"]
    if not running_pods:
        raise NoTunnelError(f"no scheduler pod runs in namespace {namespace}")
    pod = _choose_certain(running_pods, await _find_leader(client, namespace), namespace=namespace)
    ports = [port for container in pod["spec"]["containers"] for port in container.get("ports") or []]
    health_port = next((port["containerPort"] for port in ports if port.get("name") == "health"), _PORT)
    return str(pod["metadata"]["name"]), int(health_port)


def _choose_certain(running_pods: list[Pod], leader: str, *, namespace: str) -> Pod:
    """Returns the pod that holds the Lease, which only schedulers write; a label every user of the namespace may set.

    Who may not read the Lease gets any pod of the one release there is. Raises NoTunnelError.
    """
    cure = "name one with --scheduler-url"
    if leader:
        pod = next((pod for pod in running_pods if pod["metadata"]["name"] == leader), None)
        if pod is None:
            holder = f"Lease {namespace}/{_LEASE} is held by {leader}, which is no running scheduler pod"
            raise NoTunnelError(f"{holder} of this namespace: your token is not sent to another; {cure}")
        return pod
    releases = {(pod["metadata"].get("labels") or {}).get(_RELEASE, "") for pod in running_pods}
    if releases == {""} or len(releases) > 1:
        names = ", ".join(sorted(pod["metadata"]["name"] for pod in running_pods))
        raise NoTunnelError(
            f"which of {names} in namespace {namespace} is the scheduler is not certain (Lease {_LEASE} cannot be read or has "
            f"no holder, and they are not of one release, label {_RELEASE}): your token is sent to none; {cure}"
        )
    return running_pods[0]


async def _find_leader(client: ApiClient, namespace: str) -> str:
    try:
        lease = await client.get(LEASES, _LEASE, namespace=namespace)
    except ApiError:  # users seldom may read Leases
        return ""
    return str(lease.get("spec", {}).get("holderIdentity") or "")


def _name_role(refusal: str) -> str:
    """Returns what to ask for where the API server refuses a way to the scheduler."""
    if " is forbidden" not in refusal:
        return ""
    return "; ask for Role robotapp-ask-scheduler of docs/cli.md in that namespace, or name the scheduler with --scheduler-url"
