"""Our CRDs on a live control plane, and the addresses of our objects."""

from pathlib import Path
from typing import Any

from robotapp_testbed import ControlPlane

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "crds").glob("*.yaml"))
EXAMPLES = sorted((ROOT / "examples").glob("*.yaml"))
GROUP_PATH = "/apis/robotics.io/v1alpha1"
_PLURALS = {
    "RobotApp": "namespaces/default/robotapps",
    "RobotClaim": "robotclaims",
    "DomainPool": "domainpools",
    "NodeTelemetry": "nodetelemetries",
}


def install(plane: ControlPlane) -> None:
    """Apply the generated files and wait until the API server serves them."""
    for path in FILES:
        plane.kubectl("apply", "--server-side", "--force-conflicts", "-f", str(path))
    names = [f"crd/{path.stem}.robotics.io" for path in FILES]
    plane.kubectl("wait", "--for=condition=Established", "--timeout=30s", *names)


def collection(kind: str) -> str:
    return f"{GROUP_PATH}/{_PLURALS[kind]}"


def address(obj: dict[str, Any]) -> str:
    return f"{collection(obj['kind'])}/{obj['metadata']['name']}"
