"""The queue with room for two Jobs, and the app whose four Jobs wait in it. Pure."""

from typing import Any, Final

from tests.support.apiobjects import ROS

from campaigns.rigs.live import part
from robotapp_api.model.names import API_VERSION, QUEUE_NAME
from robotapp_testbed.control_plane.components import RUNS_FOR

Json = dict[str, Any]
QUEUE: Final = "nightly"
JOBS: Final = 4
ROOM: Final = 2
CPUS: Final = 1
RUNS_S: Final = 6
_API: Final = "kueue.x-k8s.io/v1beta2"


def make_queue(namespace: str) -> list[Json]:
    """Returns a flavour of nodes, a ClusterQueue of the namespace's name with room for two Jobs, and the queue that leads to it.

    The flavour has a label, so that kueue writes a node selector into the Jobs that it admits.
    """
    flavor = {"metadata": {"name": QUEUE}, "spec": {"nodeLabels": {"kubernetes.io/os": "linux"}}}
    quota = {"name": "cpu", "nominalQuota": ROOM * CPUS}
    groups = [{"coveredResources": ["cpu"], "flavors": [{"name": QUEUE, "resources": [quota]}]}]
    cluster_queue = {"metadata": {"name": namespace}, "spec": {"namespaceSelector": {}, "resourceGroups": groups}}
    local_queue = {"metadata": {"name": QUEUE, "namespace": namespace}, "spec": {"clusterQueue": namespace}}
    kinds = {"ResourceFlavor": flavor, "ClusterQueue": cluster_queue, "LocalQueue": local_queue}
    return [{"apiVersion": _API, "kind": kind, **body} for kind, body in kinds.items()]


def make_app(name: str, shape: str, pool: str) -> Json:
    """Returns an app with four Jobs in the queue: the instances of a sweep, or the components of one instance."""
    parts = [make_part(f"sim-{number}") for number in range(JOBS)] if shape == "components" else [make_part("sim")]
    matrix = {"parameters": [{"name": "seed", "values": [str(number) for number in range(JOBS)]}]}
    spec = {"ros": ROS, "ros2": {"pool": pool}, "components": parts}
    return {
        "apiVersion": API_VERSION,
        "kind": "RobotApp",
        "metadata": {"name": name, "labels": {QUEUE_NAME: QUEUE}},
        "spec": {**spec, **({"matrix": matrix} if shape == "sweep" else {})},
    }


def make_part(name: str) -> Json:
    """Returns a component that ends after a few seconds and takes half of the queue's room."""
    return part(
        name,
        job={},
        resources={"requests": {"cpu": str(CPUS)}},
        template={"metadata": {"annotations": {RUNS_FOR: f"{RUNS_S}s"}}},
    )
