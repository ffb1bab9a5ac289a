"""Asking the HTTPS port of a component of ours as a user of the cluster."""

import ssl
import urllib.error
import urllib.request

import yaml

from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.servers import unverified


def token(cp: ControlPlane, identity: str) -> str:
    """The bearer token of an identity of the testbed."""
    config = yaml.safe_load(cp.kubeconfig(identity).read_text())
    return str(config["users"][0]["user"]["token"])


def ask(
    url: str, *, bearer: str = "", body: bytes | None = None, context: ssl.SSLContext | None = None
) -> tuple[int, str]:
    """Status and text of the answer, whatever the status; POST with a body."""
    headers = {"Authorization": f"Bearer {bearer}"} if bearer else {}
    request = urllib.request.Request(url, data=body, headers=headers)  # noqa: S310 - our own
    try:
        with urllib.request.urlopen(request, context=context or unverified()) as answer:  # noqa: S310 - our own
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()
