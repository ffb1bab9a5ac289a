"""Tokens of node agents as the kubelet mounts them: bound to a pod of the chart's ServiceAccount on one node."""

from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.api import Api

NAMESPACE = "robotapp-agent"
ACCOUNT = "robotapp-agent"
USER = f"system:serviceaccount:{NAMESPACE}:{ACCOUNT}"
_PODS = f"/api/v1/namespaces/{NAMESPACE}/pods"
_TOKENS = f"/api/v1/namespaces/{NAMESPACE}/serviceaccounts/{ACCOUNT}/token"


def bound_token(plane: ControlPlane, node: str) -> str:
    """Creates the pod `agent-NODE` on the node; the token ends with it. The node must be there for its uid to be in the token."""
    spec = {
        "serviceAccountName": ACCOUNT,
        "nodeName": node,
        "terminationGracePeriodSeconds": 0,
        "containers": [{"name": "agent", "image": "registry.invalid/agent:1"}],
    }
    made = plane.api.create(
        _PODS, {"apiVersion": "v1", "kind": "Pod", "metadata": {"name": f"agent-{node}"}, "spec": spec}
    )
    return token(plane, pod=f"agent-{node}", uid=made["metadata"]["uid"])


def token(plane: ControlPlane, *, pod: str = "", uid: str = "") -> str:
    """Without a pod: a token that names no node."""
    bound = {"boundObjectRef": {"apiVersion": "v1", "kind": "Pod", "name": pod, "uid": uid}} if pod else {}
    body = {"apiVersion": "authentication.k8s.io/v1", "kind": "TokenRequest", "spec": bound}
    return str(plane.api.create(_TOKENS, body)["status"]["token"])


def remove(plane: ControlPlane, node: str) -> None:
    """The pod of `bound_token`, at once."""
    plane.kubectl(
        "delete", "pod", f"agent-{node}", "-n", NAMESPACE, "--force", "--grace-period=0", "--ignore-not-found"
    )


def api(plane: ControlPlane, bearer: str) -> Api:
    return Api(plane.server_url, ca_file=plane.ca_file, token=bearer)
