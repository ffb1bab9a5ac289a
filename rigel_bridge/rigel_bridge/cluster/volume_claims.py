"""Volume claims that stand beside a RobotApp and outlive it."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from rigel_bridge.cluster.kubectl import Kubectl
from rigel_bridge.names import BRIDGE_APP_LABEL, MANAGER

_KIND = "persistentvolumeclaims"


def apply_claims(kubectl: Kubectl, claims: Sequence[Mapping[str, Any]]) -> list[str]:
    """Create the claims that are not there, and bring the others up to date; names in order."""
    for claim in claims:
        flags = ("--server-side", "--force-conflicts", f"--field-manager={MANAGER}", "--validate=strict")
        kubectl.run("apply", *flags, "-f", "-", stdin=json.dumps(claim))
    return [claim["metadata"]["name"] for claim in claims]


def delete_claims(kubectl: Kubectl, app: str) -> list[str]:
    """Delete the claims that `apply` made for an app of this name; their names."""
    items = kubectl.items("get", _KIND, "-l", f"{BRIDGE_APP_LABEL}={app}")
    names = [item["metadata"]["name"] for item in items]
    if names:
        kubectl.run("delete", _KIND, *names, "--ignore-not-found", "--wait=false")
    return names
