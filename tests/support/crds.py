"""Our CRDs on a live control plane, and the addresses of our objects."""

from pathlib import Path
from typing import Any

from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "crds").glob("*.yaml"))
EXAMPLES = [
    path for path in sorted((ROOT / "examples").glob("*.yaml")) if "kind: RobotApp" in path.read_text(encoding="utf-8")
]
GROUP_PATH = "/apis/robotics.io/v1alpha1"
_PLURALS = {
    "RobotApp": "namespaces/default/robotapps",
    "RobotAppInstance": "namespaces/default/robotappinstances",
    "RobotClaim": "robotclaims",
    "DomainPool": "domainpools",
    "NodeTelemetry": "nodetelemetries",
}


def install(plane: ControlPlane) -> None:
    """Apply the generated files and wait until the API server serves them."""
    product.define(plane, [obj for path in FILES for obj in product.objects_of(path.read_text())])


def collection(kind: str) -> str:
    return f"{GROUP_PATH}/{_PLURALS[kind]}"


def address(obj: dict[str, Any]) -> str:
    return f"{collection(obj['kind'])}/{obj['metadata']['name']}"
