"""A RobotApp whose pods really run, through faults of nodes: what runs goes on, claims stay, the status comes back."""

import secrets
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import yaml

from campaigns.nodes.real_pods import component
from campaigns.rigs.live import Tenant, eventually, pool
from robotapp_scheduler.config.model import API_VERSION, KIND
from robotapp_testbed.control_plane import components_as_pods, product
from robotapp_testbed.control_plane.components_as_pods import round_trip
from robotapp_testbed.real import RealNodes

pytestmark = pytest.mark.live

READY_S = 120.0
NOTICED_S = 90.0
CUT_S = 12.0


@pytest.fixture(scope="module")
def plane(real_nodes: RealNodes, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealNodes]:
    """The real nodes with our operator and scheduler, and the chart's agents, which measure the link.

    Neither has a Lease: nobody would start them again when they lose it because a busy machine takes ten seconds to bring
    the API server back.
    """
    product.install(real_nodes)
    alone = tmp_path_factory.mktemp("scheduler") / "config.yaml"
    alone.write_text(
        yaml.safe_dump({"apiVersion": API_VERSION, "kind": KIND, "leaderElection": {"leaderElect": False}})
    )
    mark = secrets.token_hex(2)
    operator = product.start_operator(real_nodes, name=f"operator-{mark}", sweep_seconds=1, no_leader_election=True)
    scheduler = product.start_scheduler(real_nodes, alone, name=f"scheduler-{mark}")
    with components_as_pods.agents(real_nodes, interval_s=5):
        components_as_pods.wait_measured(real_nodes)
        yield real_nodes
        assert operator.running
        assert scheduler.running
    scheduler.stop()
    operator.stop()


@pytest.fixture
def app(plane: RealNodes, real_namespace: str) -> Iterator[Tenant]:
    """The app `teleop`, Ready: a driver on the robot and an operator's side that must be near."""
    tenant = Tenant(plane, real_namespace)
    with pool(plane, f"pool-{secrets.token_hex(3)}") as ids:
        tenant.apply(
            "teleop",
            component("console"),
            component("driver", runsOn=["Robot"]),
            robots={"nodeSelector": {"matchLabels": {"robotics.io/robot": "robot-1"}}},
            edges=[{"topic": "/cmd_vel", "from": "console", "to": "driver", "latency": {"budget": "80ms"}}],
            ros2={"pool": ids, "discovery": {"mode": "Multicast"}},  # no image of a discovery server
        )
        tenant.wait_ready("teleop", timeout_s=READY_S)
        yield tenant
        plane.wait_nodes()
        tenant.delete("teleop")
        eventually(lambda: not tenant.claims(), timeout_s=READY_S)


def containers(tenant: Tenant) -> dict[str, tuple[str, int]]:
    """Container id and restarts, by component."""
    found = {}
    for each in tenant.listed("pods"):
        (status,) = each["status"]["containerStatuses"]
        found[each["metadata"]["labels"]["robotics.io/component"]] = (status["containerID"], status["restartCount"])
    return found


def claims(tenant: Tenant) -> list[tuple[str, str]]:
    return [(claim["metadata"]["name"], claim["metadata"]["uid"]) for claim in tenant.claims()]


def node_of(tenant: Tenant, component: str) -> str:
    (one,) = (
        each for each in tenant.listed("pods") if each["metadata"]["labels"]["robotics.io/component"] == component
    )
    return str(one["spec"]["nodeName"])


def survives(tenant: Tenant, hurt: Callable[[], None], mend: Callable[[], None], *, seen: bool = True) -> None:
    """Nothing of the app is touched by a fault, and its status tells of it and recovers."""
    pods, held = containers(tenant), claims(tenant)
    assert {restarts for _, restarts in pods.values()} == {0}
    hurt()
    try:
        if seen:
            tenant.wait("teleop", "Ready", "False", timeout_s=NOTICED_S)
        assert claims(tenant) == held
    finally:
        mend()
    tenant.wait_ready("teleop", timeout_s=READY_S)
    assert (containers(tenant), claims(tenant)) == (pods, held)


def test_the_app_runs_where_its_domain_was_granted(app: Tenant) -> None:
    (claim,) = app.claims()
    pods = {each["metadata"]["labels"]["robotics.io/component"]: each for each in app.listed("pods")}
    assert pods["driver"]["spec"]["nodeName"] == "robot-1"
    name = pods["driver"]["metadata"]["name"]
    said = app.cp.kubectl("exec", "-n", app.namespace, name, "--", "sh", "-c", "echo $ROS_DOMAIN_ID")
    assert said.strip() == str(claim["spec"]["domain"]["id"])


def test_telemetry_says_what_was_measured_on_the_links(plane: RealNodes) -> None:
    def written_us() -> int:
        return int(round_trip(plane, "robot-1", "edge-1").get("p50Us", 0))

    plane.switch.set_link("robot-1", "edge-1", delay_ms=20)
    try:
        assert plane.node("robot-1").ping(plane.node("edge-1")).loss_ppm == 0
        eventually(lambda: 40_000 <= written_us() < 80_000, timeout_s=NOTICED_S)
    finally:
        plane.switch.set_link("robot-1", "edge-1", delay_ms=0)


def test_it_outlives_a_kubelet(app: Tenant, plane: RealNodes) -> None:
    kubelet = plane.node("robot-1").kubelet
    survives(app, kubelet.kill, lambda: kubelet.start() and None)


def test_it_outlives_being_cut_off(app: Tenant, plane: RealNodes) -> None:
    robot = plane.node("robot-1")
    survives(app, robot.cut_off, robot.reconnect)


def test_it_outlives_the_api_server(app: Tenant, plane: RealNodes) -> None:
    server = plane.process("kube-apiserver")
    survives(app, lambda: server.restart() and None, plane.wait_nodes, seen=False)


def test_it_outlives_12_seconds_without_the_switch(app: Tenant, plane: RealNodes) -> None:
    """Links that are cut for as long as that are in test_teleoperation.py, with real DDS."""
    switch = plane.process("latency-switch")

    def away() -> None:
        switch.kill()
        time.sleep(CUT_S)  # longer than the lease of a DDS participant
        assert loss_ppm() == 1_000_000

    def again() -> None:
        switch.start().wait_ready()
        plane.plug_switch()

    def loss_ppm() -> int:
        return plane.node("robot-1").ping(plane.node("edge-1")).loss_ppm

    survives(app, away, again, seen=False)
    eventually(lambda: loss_ppm() == 0, timeout_s=NOTICED_S)  # the kernel asks for lost neighbours once a second


def test_a_container_that_dies_is_started_again_with_the_same_domain(app: Tenant, plane: RealNodes) -> None:
    before, held = containers(app)["driver"], claims(app)
    plane.node("robot-1").kill_container(before[0])
    eventually(lambda: containers(app)["driver"][1] > before[1], timeout_s=READY_S)
    app.wait_ready("teleop", timeout_s=READY_S)
    assert claims(app) == held


def test_a_robot_that_crashes_comes_back_with_its_app(app: Tenant, plane: RealNodes) -> None:
    held, before = claims(app), containers(app)["driver"]
    robot = plane.node("robot-1")
    robot.crash()
    app.wait("teleop", "Ready", "False", timeout_s=NOTICED_S)
    assert claims(app) == held
    robot.restart()
    plane.wait_nodes()
    app.wait_ready("teleop", timeout_s=READY_S)
    eventually(lambda: containers(app)["driver"] != before, timeout_s=READY_S)
    assert (claims(app), node_of(app, "driver")) == (held, "robot-1")


READS_ITS_FILES = 'for file in $(echo "$ROBOTAPP_PARAMETER_FILES" | tr : " "); do cat "$file"; echo; done; echo "$@"; trap exit TERM; while :; do sleep 1 & wait; done'


def test_parameter_files_arrive_in_their_order_and_another_content_starts_the_pod_anew(
    plane: RealNodes, real_namespace: str
) -> None:
    tenant = Tenant(plane, real_namespace)
    config = {"common.yaml": "common", "robot-1.yaml": "for robot-1"}
    plane.kubectl("apply", "-n", real_namespace, "-f", "-", stdin=config_map("drv", config))
    secret = {"apiVersion": "v1", "kind": "Secret", "metadata": {"name": "key"}, "stringData": {"s.yaml": "secret"}}
    plane.kubectl("apply", "-n", real_namespace, "-f", "-", stdin=secret)
    inline = "/**: {ros__parameters: {v: 1.0}}"
    files = [
        {"configMapKeyRef": {"name": "drv", "key": "common.yaml"}},
        {"configMapKeyRef": {"name": "drv", "key": "$(ROBOTAPP_ROBOT).yaml", "optional": True}},
        {"configMapKeyRef": {"name": "drv", "key": "nobody.yaml", "optional": True}},
        {"secretKeyRef": {"name": "key", "key": "s.yaml"}},
        {"inline": inline},
    ]
    driver = component("driver", command=["sh", "-c"], parameters=files, runsOn=["Robot"])
    driver["args"] = [READS_ITS_FILES, "driver"]
    with pool(plane, f"pool-{secrets.token_hex(3)}") as ids:
        selector = {"matchLabels": {"robotics.io/robot": "robot-1"}}
        tenant.apply("files", driver, robots={"nodeSelector": selector}, ros2={"pool": ids})
        tenant.wait_ready("files", timeout_s=READY_S)
        paths = [f"--params-file /etc/robotapp/parameters/{number}.yaml" for number in (0, 1, 3, 4)]
        said = f"common\nfor robot-1\nsecret\n{inline}\n--ros-args {' '.join(paths)}"
        eventually(lambda: log_of(tenant, plane) == said, timeout_s=READY_S)
        config["common.yaml"] = "something else"
        plane.kubectl("apply", "-n", real_namespace, "-f", "-", stdin=config_map("drv", config))
        eventually(lambda: log_of(tenant, plane) == said.replace("common", "something else", 1), timeout_s=READY_S)
        tenant.delete("files")
        eventually(lambda: not tenant.claims(), timeout_s=READY_S)


MISSING: list[tuple[str, dict[str, Any], str]] = [
    (
        "volume",
        {
            "volumeMounts": [{"name": "v", "mountPath": "/v"}],  # without one the kubelet does not ask for the Secret
            "template": {"spec": {"volumes": [{"name": "v", "secret": {"secretName": "tokens"}}]}},
        },
        'secret "tokens" not found',
    ),
    ("env", {"envFrom": [{"secretRef": {"name": "tokens"}}]}, 'secret "tokens" not found'),
    (
        "pull",
        {"image": "registry.invalid/nobody/driver:1", "template": {"spec": {"imagePullSecrets": [{"name": "tokens"}]}}},
        "Unable to retrieve some image pull secrets (tokens)",
    ),
]
NAMED_S = 5.0


def test_a_missing_secret_is_named_within_five_seconds_of_the_pods_start_and_heals(
    plane: RealNodes, real_namespace: str
) -> None:
    """The operator reads no Secret: what the kubelet reports of the pod is all it has."""
    tenant = Tenant(plane, real_namespace)
    with pool(plane, f"pool-{secrets.token_hex(3)}") as ids:
        for name, fields, text in MISSING:
            tenant.apply(name, component("driver") | fields, ros2={"pool": ids, "discovery": {"mode": "Multicast"}})
            pod = eventually(lambda name=name: bound_pod(tenant, name), timeout_s=READY_S)
            bound_s = time.monotonic()
            eventually(
                lambda name=name, text=text: text in tenant.condition(name, "Ready")["message"],
                timeout_s=READY_S,
                what=lambda name=name: tenant.app(name),
            )
            took_s = time.monotonic() - bound_s
            # A pull is tried first, and fails when the registry's name does.
            assert took_s < NAMED_S or name == "pull", f"{name}: {pod} was named {took_s:.1f} s after it was bound"
        volume = {"name": "v", "persistentVolumeClaim": {"claimName": "bags"}}
        multicast = {"pool": ids, "discovery": {"mode": "Multicast"}}
        tenant.apply("claim", component("driver", template={"spec": {"volumes": [volume]}}), ros2=multicast)
        eventually(
            lambda: 'persistentvolumeclaim "bags" not found' in tenant.condition("claim", "Ready")["message"],
            timeout_s=READY_S,
        )
        secret = {"apiVersion": "v1", "kind": "Secret", "metadata": {"name": "tokens"}, "stringData": {"k": "v"}}
        plane.kubectl("apply", "-n", real_namespace, "-f", "-", stdin=secret)
        for name in ("volume", "env"):
            tenant.wait_ready(name, timeout_s=READY_S)
        for name in ("claim", *(name for name, _, _ in MISSING)):
            tenant.delete(name)
        eventually(lambda: not tenant.claims(), timeout_s=READY_S)


def bound_pod(tenant: Tenant, app: str) -> str:
    """The name of the app's pod once it is on a node."""
    pods = [pod for pod in tenant.listed("pods") if pod["metadata"]["labels"].get("robotics.io/app") == app]
    return next((pod["metadata"]["name"] for pod in pods if pod["spec"].get("nodeName")), "")


def config_map(name: str, data: dict[str, str]) -> dict[str, Any]:
    return {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": name}, "data": data}


def log_of(tenant: Tenant, plane: RealNodes) -> str:
    """What the one pod that is not going has said."""
    pods = [pod for pod in tenant.listed("pods") if "deletionTimestamp" not in pod["metadata"]]
    if len(pods) != 1:
        return ""
    return plane.kubectl("logs", "-n", tenant.namespace, pods[0]["metadata"]["name"], check=False).strip()
