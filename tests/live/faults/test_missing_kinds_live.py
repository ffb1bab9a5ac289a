"""A CRD or a right is missing on a real API server: what does not need it goes on, and what does says so. Its own control plane."""

from collections.abc import Iterator

import pytest

from campaigns.rigs.ports import ask
from campaigns.rigs.simulated_site import plain_app
from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_api.model.names import Annotation
from robotapp_testbed import ControlPlane, Process, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines.nodes import edge

pytestmark = pytest.mark.live

WITHIN_S = 90.0
LACKING = "nodetelemetries"
OPERATOR = "robotapp-operator"


@pytest.fixture
def plane() -> Iterator[ControlPlane]:
    with ControlPlane(kwok=False, controller_manager=False) as started:
        product.install(started)
        yield started


def read_readiness(process: Process) -> tuple[int, str]:
    return ask(f"{process.health_url}/readyz")


def test_a_scheduler_without_a_crd_places_plain_pods_names_the_kind_and_the_others_when_it_is_there(
    plane: ControlPlane,
) -> None:
    plane.kubectl("delete", "crd", f"{LACKING}.robotics.io")
    stage = Stage(plane, "default")
    with nodes(plane, edge("edge-1")):
        scheduler = product.start_scheduler(plane, name="lacking", wait=False, sweep_seconds=1, log_format="text")
        stage.create_pod(pod("plain"))
        stage.create_pod(pod("ros", annotations={Annotation.DDS_DOMAIN.value: "auto"}))
        stage.wait_bound("plain", timeout_s=WITHIN_S)
        assert wait_until(lambda: read_readiness(scheduler)[0] == 503, timeout_s=WITHIN_S)
        assert f"[-]kind-{LACKING} failed" in read_readiness(scheduler)[1]
        assert "nodeName" not in plane.api.get("/api/v1/namespaces/default/pods/ros")["spec"]
        product.install(plane)
        stage.wait_bound("ros", timeout_s=WITHIN_S)
        assert wait_until(lambda: read_readiness(scheduler)[0] == 200, timeout_s=WITHIN_S)
        assert scheduler.running
        assert "Traceback" not in scheduler.log_text()


def test_an_operator_without_a_right_says_so_in_a_sentence_and_works_when_it_has_it(plane: ControlPlane) -> None:
    path = f"/apis/rbac.authorization.k8s.io/v1/clusterroles/{OPERATOR}"
    rules = plane.api.get(path)["rules"]
    plane.api.patch(path, {"rules": [rule for rule in rules if rule.get("resources") != ["robotapps"]]})
    operator = product.start_operator(plane, name="unbound", wait=False, log_format="text")
    app = plain_app("waits")
    plane.api.create(f"/apis/{app['apiVersion']}/namespaces/default/robotapps", app)
    assert wait_until(lambda: "RobotApps are not watched: " in operator.log_text(), timeout_s=WITHIN_S), (
        operator.log_text()[-3000:]
    )
    assert operator.running
    assert "Traceback" not in operator.log_text()
    plane.api.patch(path, {"rules": rules})
    deployments = "/apis/apps/v1/namespaces/default/deployments"
    assert wait_until(lambda: bool(plane.api.get(deployments)["items"]), timeout_s=WITHIN_S), operator.log_text()[
        -3000:
    ]
    assert wait_until(lambda: read_readiness(operator)[0] == 200, timeout_s=WITHIN_S)
