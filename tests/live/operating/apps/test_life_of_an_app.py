"""From apply to delete, as a user sees it."""

import secrets
import time
from typing import Any

import pytest

from campaigns.rigs.live import HandBinder, Tenant, eventually, part, pool
from robotapp_api.model.names import FLEET_CONFIG_MAP, Annotation
from robotapp_client.serving.tls import AUTHENTICATION
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import namespaces, product
from robotapp_testbed.machines import topology
from robotapp_testbed.machines.telemetry import PATH as TELEMETRY
from robotapp_testbed.machines.telemetry import create as create_telemetry
from robotapp_testbed.machines.telemetry import node_uids

pytestmark = pytest.mark.usefixtures("operator")

OPERATOR = "system:serviceaccount:robotapp-system:robotapp-operator"
ANY_ROBOT = {"nodeSelector": {"matchLabels": {"robotics.io/tier": "robot"}}, "assignment": "Any"}
AUTOSCALED_S = 60.0
"""The controller of autoscalers looks every 15 s."""
EACH_ROBOT = {"nodeSelector": {"matchLabels": {"robotics.io/tier": "robot"}}}


def env_of(deployment: dict[str, Any]) -> dict[str, str]:
    (container,) = deployment["spec"]["template"]["spec"]["containers"]
    return {item["name"]: item.get("value", "") for item in container["env"]}


def domains_of(tenant: Tenant, name: str) -> dict[str, int]:
    """Domain of each of the two instances of an app, by its robot."""
    return {item["spec"]["robot"]: item["status"]["domain"] for item in tenant.wait_instances(name, 2)}


def test_an_applied_app_becomes_ready_with_one_claimed_domain(tenant: Tenant, ids: str) -> None:
    tenant.apply("teleop", part("operator"), part("driver", runsOn=["Robot"]), robots=ANY_ROBOT, ros2={"pool": ids})
    app = tenant.wait_ready("teleop")
    (claim,) = tenant.claims()
    domain = claim["spec"]["domain"]["id"]
    assert claim["metadata"]["name"] == f"dds.{ids}.c.{domain}"
    assert {env_of(item)["ROS_DOMAIN_ID"] for item in tenant.deployments()} == {str(domain)}
    (instance,) = tenant.wait_instances("teleop")
    assert claim["spec"]["holder"]["instance"] == instance["spec"]["robot"]
    driver = next(item for item in instance["status"]["components"] if item["name"] == "driver")
    assert driver["node"] == instance["spec"]["robot"]
    assert instance["status"]["domain"] == domain
    counts = {"desired": 1, "ready": 1}
    assert {key: value for key, value in app["status"]["instanceCounts"].items() if value} == counts
    assert app["status"].get("troubled", []) == []
    assert app["status"]["observedGeneration"] == app["metadata"]["generation"]
    assert app["status"]["phase"] == "Running"
    summary = app["status"]["summary"]
    assert (summary["ready"], summary["robots"], summary["domain"]) == ("2/2", "1/1", str(domain))
    assert len({item["type"] for item in app["status"]["conditions"]}) == 7


def test_a_pod_that_names_the_default_account_gets_no_token_of_it_either(tenant: Tenant, ids: str) -> None:
    named = part("named", template={"spec": {"serviceAccountName": "default"}})
    tenant.apply("tokens", named, part("unnamed"), ros2={"pool": ids})
    tenant.wait_ready("tokens")
    pods = tenant.listed("pods")
    assert {pod["spec"]["serviceAccountName"] for pod in pods} == {"default"}
    bare = {"metadata": {"name": "bare"}, "spec": {"containers": [{"name": "a", "image": "i"}]}}
    usual = tenant.cp.api.create(f"/api/v1/namespaces/{tenant.namespace}/pods?dryRun=All", bare)
    assert any("projected" in volume for volume in usual["spec"]["volumes"]), "admission adds the token as a volume"
    assert not any("projected" in volume for pod in pods for volume in pod["spec"].get("volumes", []))


def test_one_instance_and_one_domain_per_robot(tenant: Tenant, ids: str) -> None:
    tenant.apply("fleet", part("driver", runsOn=["Robot"]), robots=EACH_ROBOT, ros2={"pool": ids})
    assert tenant.wait_ready("fleet")["status"]["instanceCounts"]["desired"] == 2
    domains = domains_of(tenant, "fleet")
    assert len(domains) == len(set(domains.values())) == 2
    for deployment in tenant.deployments():
        robot = deployment["metadata"]["labels"]["robotics.io/instance"]
        assert env_of(deployment)["ROS_DOMAIN_ID"] == str(domains[robot])


def test_deleting_an_app_leaves_nothing(tenant: Tenant, ids: str) -> None:
    tenant.apply("gone", ros2={"pool": ids})
    tenant.wait_ready("gone")
    tenant.delete("gone")
    # The garbage collector learns about new kinds every 30 s; after that it takes a second.
    eventually(lambda: not tenant.children() and not tenant.claims(), timeout_s=90, what=tenant.children)


def test_a_removed_component_is_pruned_and_an_added_one_appears(tenant: Tenant, ids: str) -> None:
    tenant.apply("shape", part("a"), part("b"), ros2={"pool": ids})
    tenant.wait_ready("shape")
    (claim,) = tenant.claims()
    tenant.edit("shape", components=[part("a"), part("c")])
    eventually(
        lambda: {item["metadata"]["labels"]["robotics.io/component"] for item in tenant.deployments()} == {"a", "c"}
    )
    tenant.wait_ready("shape")
    assert [item["metadata"]["uid"] for item in tenant.claims()] == [claim["metadata"]["uid"]]


def test_fields_taken_out_of_the_spec_leave_the_deployment(tenant: Tenant, ids: str) -> None:
    """Server-side apply removes only what the same manager applied: the first write was a POST."""
    selector = {"kubernetes.io/os": "linux"}
    rich = part(
        "a",
        template={"spec": {"nodeSelector": selector}},
        resources={"requests": {"cpu": "1000m"}},
        env=[{"name": "X", "value": "1"}],
    )
    tenant.apply("lean", rich, ros2={"pool": ids})
    eventually(tenant.deployments)
    tenant.edit("lean", components=[part("a")])

    def template() -> dict[str, Any]:
        (deployment,) = tenant.deployments()
        spec: dict[str, Any] = deployment["spec"]["template"]["spec"]
        return spec

    eventually(lambda: "nodeSelector" not in template(), what=template)
    assert template()["containers"][0]["resources"] == {}
    (deployment,) = tenant.deployments()
    assert "X" not in env_of(deployment)


def test_replicas_may_grow_and_shrink_with_their_strategy(tenant: Tenant, ids: str) -> None:
    tenant.apply("many", part("a", replicas=2), ros2={"pool": ids})
    tenant.wait_ready("many")
    for replicas, strategy in ((1, "Recreate"), (2, "RollingUpdate")):
        tenant.edit("many", components=[part("a", replicas=replicas)])
        eventually(lambda: tenant.deployments()[0]["spec"]["strategy"]["type"] == strategy)  # noqa: B023 - used at once
        tenant.wait_ready("many")


def test_drift_is_repaired_and_costs_one_write(tenant: Tenant, ids: str) -> None:
    tenant.apply("steady", part("a"), ros2={"pool": ids})
    tenant.wait_ready("steady")
    (deployment,) = tenant.deployments()
    path = f"/apis/apps/v1/namespaces/{tenant.namespace}/deployments/{deployment['metadata']['name']}"
    tenant.cp.kubectl("scale", "-n", tenant.namespace, f"deployment/{deployment['metadata']['name']}", "--replicas=3")
    eventually(lambda: tenant.deployments()[0]["spec"]["replicas"] == 1)
    asked = ("get", "events", "-n", tenant.namespace, "--field-selector=reason=ReplicasSetBack", "-o", "yaml")
    eventually(lambda: "write spec.components[0].replicas" in tenant.cp.kubectl(*asked))
    assert "was scaled by kubectl and" in tenant.cp.kubectl(*asked)
    image = [{"op": "replace", "path": "/spec/template/spec/containers/0/image", "value": "evil"}]
    tenant.cp.api.patch(path, image, content_type="application/json-patch+json")  # type: ignore[arg-type] - a JSON patch is a list
    eventually(lambda: "evil" not in str(tenant.deployments()[0]["spec"]))
    tenant.wait_ready("steady")
    version = tenant.deployments()[0]["metadata"]["generation"]
    time.sleep(1.5)
    assert tenant.deployments()[0]["metadata"]["generation"] == version


def test_an_autoscaler_of_a_component_is_named_with_its_cure_and_the_replicas_stay_the_apps(
    tenant: Tenant, ids: str
) -> None:
    tenant.apply("scaled", part("a"), ros2={"pool": ids})
    tenant.wait_ready("scaled")
    name = tenant.deployments()[0]["metadata"]["name"]
    target = {"apiVersion": "apps/v1", "kind": "Deployment", "name": name}
    autoscaler = {
        "apiVersion": "autoscaling/v2",
        "kind": "HorizontalPodAutoscaler",
        "metadata": {"name": "a", "namespace": tenant.namespace},
        "spec": {
            "scaleTargetRef": target,
            "minReplicas": 3,
            "maxReplicas": 4,
        },  # below the minimum it asks for no metrics
    }
    path = f"/apis/autoscaling/v2/namespaces/{tenant.namespace}/horizontalpodautoscalers"
    tenant.cp.api.create(path, autoscaler)
    asked = ("get", "events", "-n", tenant.namespace, "--field-selector=reason=ReplicasSetBack", "-o", "yaml")
    eventually(lambda: "HorizontalPodAutoscaler" in tenant.cp.kubectl(*asked), timeout_s=AUTOSCALED_S)
    note = " ".join(tenant.cp.kubectl(*asked).split())
    assert "write spec.components[0].replicas of RobotApp scaled" in note
    assert "delete the HorizontalPodAutoscaler, which a RobotApp does not follow" in note
    tenant.cp.api.delete(f"{path}/a")
    eventually(lambda: tenant.deployments()[0]["spec"]["replicas"] == 1)
    tenant.wait_ready("scaled")


def test_a_deleted_child_comes_back(tenant: Tenant, ids: str) -> None:
    tenant.apply("back", part("a"), ros2={"pool": ids})
    tenant.wait_ready("back")
    (deployment,) = tenant.deployments()
    name = deployment["metadata"]["name"]
    tenant.cp.api.delete(f"/apis/apps/v1/namespaces/{tenant.namespace}/deployments/{name}")
    eventually(
        lambda: [i["metadata"]["uid"] for i in tenant.deployments()] not in ([], [deployment["metadata"]["uid"]])
    )
    tenant.wait_ready("back")
    assert len(tenant.claims()) == 1


def test_suspend_stops_the_pods_and_keeps_the_claim(tenant: Tenant, ids: str) -> None:
    tenant.apply("pause", ros2={"pool": ids})
    tenant.wait_ready("pause")
    (claim,) = tenant.claims()
    tenant.edit("pause", suspend=True)
    tenant.wait("pause", "Ready", "False", reason="Suspended")
    eventually(lambda: not tenant.listed("pods"))
    eventually(lambda: tenant.app("pause")["status"]["phase"] == "Suspended")
    assert [item["metadata"]["uid"] for item in tenant.claims()] == [claim["metadata"]["uid"]]
    tenant.edit("pause", suspend=False)
    tenant.wait_ready("pause")


def test_an_app_under_another_scheduler_is_released_from_its_gate(tenant: Tenant, ids: str) -> None:
    tenant.apply("gated", part("a"), ros2={"pool": ids}, schedulerName="by-hand")
    tenant.wait_ready("gated")
    assert tenant.deployments()[0]["spec"]["template"]["spec"]["schedulingGates"] == [{"name": "robotics.io/domain"}]


def test_ros_1_gets_a_master_and_no_domain(tenant: Tenant) -> None:
    tenant.apply("classic", part("talker"), ros={"distro": "noetic"})
    tenant.wait_ready("classic")
    assert tenant.claims() == []
    env = env_of(tenant.deployments("talker")[0])
    masters = [item for item in tenant.listed("services") if "master" in item["metadata"]["name"]]
    assert env["ROS_MASTER_URI"] == f"http://{masters[0]['metadata']['name']}:11311"


def test_another_parameters_file_rolls_the_pods(tenant: Tenant, ids: str) -> None:
    def write(text: str, name: str = "drv") -> None:
        body = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": name}, "data": {"params.yaml": text}}
        tenant.cp.kubectl("apply", "-n", tenant.namespace, "-f", "-", stdin=body)

    write("speed: 1")
    write("not for the operator", "bystander")
    file = {"configMapKeyRef": {"name": "drv", "key": "params.yaml"}}
    tenant.apply("tuned", part("a", args=["run"], parameters=[file]), ros2={"pool": ids})
    tenant.wait_ready("tuned")

    def mark() -> str:
        annotations = tenant.deployments()[0]["spec"]["template"]["metadata"]["annotations"]
        return str(annotations[Annotation.PARAMETERS_HASH])

    before = mark()
    write("speed: 2")
    eventually(lambda: mark() != before)
    tenant.wait_ready("tuned")
    looks = {
        (item["verb"], item["requestURI"].partition("?")[0].rpartition("/")[2])
        for item in tenant.cp.audit()
        if item["user"]["username"] == OPERATOR
        and item.get("objectRef", {}).get("resource") == "configmaps"
        and item["objectRef"].get("namespace", tenant.namespace) == tenant.namespace  # others' apps name others
    }
    assert ("get", "drv") in looks
    assert looks <= {
        *((verb, "configmaps") for verb in ("list", "watch")),  # of metadata: see attacks/test_absent_names_live.py
        ("get", "drv"),
        ("create", "configmaps"),
        *((verb, FLEET_CONFIG_MAP) for verb in ("get", "update", "delete")),
        ("get", f"{FLEET_CONFIG_MAP}-2"),  # of an operator that needed two
        ("get", AUTHENTICATION[1]),  # whose client certificates are good at its own port
    }, "it reads ConfigMaps that apps name, one by one, and writes the fleet view"


def test_the_fleet_view_shows_where_things_run_and_vanishes_with_them(tenant: Tenant, ids: str) -> None:
    tenant.apply("seen", part("driver", runsOn=["Robot"]), robots=EACH_ROBOT, ros2={"pool": ids})
    tenant.wait_ready("seen")
    wanted = {
        f"app.seen.{robot}": f"domain={domain} driver@{robot}" for robot, domain in domains_of(tenant, "seen").items()
    }

    def view() -> dict[str, str]:
        maps = [m for m in tenant.listed("configmaps") if m["metadata"]["name"] == "robot-fleet-assignments"]
        data: dict[str, str] = maps[0].get("data", {}) if maps else {}
        return data

    eventually(lambda: view() == wanted, what=view)
    tenant.delete("seen")
    eventually(lambda: not view())


def test_latency_is_measured_where_the_edges_are_and_judged(
    installed_plane: ControlPlane, nodes: topology.Topology, tenant: Tenant, ids: str
) -> None:
    edge = {"topic": "/cmd_vel", "from": "operator", "to": "driver", "latency": {"budget": "30ms"}}
    parts = [part("operator", runsOn=["Cloud"]), part("driver", runsOn=["Robot"])]
    with topology.SimulatedTelemetry(installed_plane, nodes) as telemetry:
        tenant.apply("near", *parts, robots=ANY_ROBOT, edges=[edge], ros2={"pool": ids})
        tenant.wait_ready("near")
        robot = tenant.claims()[0]["spec"]["holder"]["instance"]
        found = tenant.wait("near", "BudgetMet", "False", reason="BudgetExceeded")
        assert "/cmd_vel operator -> driver" in found["message"]
        assert "of 30ms" in found["message"]
        telemetry.set_rtt("cloud-1", robot, 12.0)
        tenant.wait("near", "BudgetMet", "True", reason="WithinBudget")
        assert tenant.app("near")["status"]["summary"]["budget"].endswith("/30ms")

        def asked() -> bool:
            found = installed_plane.api.get("/apis/robotics.io/v1alpha1/nodetelemetries")["items"]
            lists = {item["metadata"]["name"]: item.get("spec", {}).get("probe", []) for item in found}
            return robot in lists.get("cloud-1", []) or "cloud-1" in lists.get(robot, [])

        eventually(asked)
        for name, uid in node_uids(installed_plane).items():
            if name in ("cloud-1", robot):  # an agent that is installed later, and makes its object itself
                installed_plane.api.delete(f"{TELEMETRY}/{name}")
                create_telemetry(installed_plane, name, uid=uid, labels={})
        eventually(asked)
        tenant.delete("near")
        eventually(lambda: not asked())


def test_an_operator_of_one_namespace_leaves_the_others_alone(
    installed_plane: ControlPlane, tenant: Tenant, ids: str
) -> None:
    with (
        namespaces.created(installed_plane, f"served-{secrets.token_hex(2)}") as other,
        HandBinder(installed_plane, other),
        pool(installed_plane, f"pool-{secrets.token_hex(2)}") as own,
    ):
        process = product.start_operator(
            installed_plane, name="operator-narrow", namespaces=other, no_leader_election=True, sweep_seconds=1
        )
        try:
            Tenant(installed_plane, other).apply("here", part("a"), ros2={"pool": own})
            Tenant(installed_plane, other).wait_ready("here")
        finally:
            process.stop()
        tenant.apply("there", part("a"), ros2={"pool": ids})
        tenant.wait_ready("there")  # by the operator of all namespaces
        assert tenant.namespace not in process.log_text()
