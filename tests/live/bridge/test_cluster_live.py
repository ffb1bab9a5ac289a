"""The bridge's commands on the real control plane, as a user: one stage for all of them, because it takes longer than they do."""

import json
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.live.bridge.conftest import USER, Stage
from tests.live.bridge.test_accepted_live import SAMPLES
from tests.live.bridge.test_rigel03 import RIGELFILE as WITH_JOBS
from tests.support.rigel.rigelfiles import TWO, orchestration
from tests.support.ros_sources import package, python_node, setup_py

from campaigns.rigs.live import HandBinder, eventually, pool
from campaigns.rigs.stage import IMAGE
from rigel_bridge.document.failures import Exit
from rigel_bridge.main import main
from rigel_bridge.sequences import lease
from rigel_bridge.sequences.run import read_summaries
from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_testbed.failures import CommandError
from ros_profile.main import main as profile
from ros_profile.output.robotapp import IMAGE as PLACEHOLDER

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = ROOT / "examples" / "rigel"
THESIS = ROOT / "tests" / "golden" / "thesis"
pytestmark = pytest.mark.live


def rigelfile(folder: Path, stage: Stage, *, image: str = "acme/driver:1", extra: str = "") -> str:
    """A Rigelfile of the app `teleop`, which runs in the stage's own pool."""
    path = folder / "Rigelfile"
    block = f"{{name: teleop, robotapp: {{ros2: {{pool: {stage.pool}}}{extra}}}}}"
    path.write_text(orchestration(block, TWO).replace("acme/driver:1", image))
    return str(path)


def test_an_app_lives_from_apply_to_delete_with_the_rights_of_its_user(
    stage: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = everything(stage)
    first = rigelfile(tmp_path, stage)
    assert stage.run("diff", first) == 1, "all of it is new"
    assert stage.run("apply", first, "--wait", "60s") == 0, capsys.readouterr().err
    stored = stage.app("teleop")
    assert stage.run("apply", first) == stage.run("diff", first) == 0
    assert "teleop in namespace" in (told := capsys.readouterr().out)
    assert told.endswith(": unchanged\n"), "and no line of the diff"
    assert stage.app("teleop")["metadata"]["resourceVersion"] == stored["metadata"]["resourceVersion"]

    second = rigelfile(tmp_path, stage, image="acme/driver:2", extra=", placement: {gang: None}")
    assert stage.run("diff", second) == 1
    assert "+  image: acme/driver:2" in capsys.readouterr().out
    assert stage.run("apply", second) == 0
    assert "spec.components[0].image: acme/driver:1 -> acme/driver:2" in capsys.readouterr().out
    stage.edit("teleop", {"connectivity": {"grace": "9m"}, "placement": {"zones": ["hall-1"]}})
    edited = text(stage.app("teleop")["spec"])

    assert stage.run("rollback", "teleop", "--to", "1", "--wait", "60s", "--yes") == 0, capsys.readouterr().err
    assert text(stage.app("teleop")["spec"]) == text(stored["spec"]), "what others wrote since is undone too"
    assert stage.run("rollback", "teleop", "--yes") == 0
    assert text(stage.app("teleop")["spec"]) == edited, "the hand-made spec was kept, and is the last other one"
    assert len(revisions(stage)) == 3
    more(stage, revisions(stage)[-1], first=100, count=8)
    assert stage.run("apply", rigelfile(tmp_path, stage, image="acme/driver:9")) == 0
    kept = revisions(stage)
    assert len(kept) == 10
    uid = stored["metadata"]["uid"]
    assert all(each["metadata"]["ownerReferences"][0]["uid"] == uid for each in kept)
    assert stage.run("rollback", "teleop", "--to", "1") == 76, "the oldest has gone"
    assert stage.run("status", "teleop") in (0, 75)
    assert "(present)" in capsys.readouterr().out

    assert stage.run("delete", "teleop", "--wait", "90s") == 0, capsys.readouterr().err
    assert everything(stage) <= before
    stage.gone("teleop")
    assert stage.run("delete", "teleop") == 0, "once more is no error"
    assert stage.run("status", "teleop") == 76


def everything(stage: Stage) -> set[str]:
    """Uids of what is in the namespace: other tests, which may run before, leave a pod that samples name."""
    kinds = ("ra,rai,deploy,pods,services", "controllerrevisions")
    return {item["metadata"]["uid"] for kind in kinds for item in stage.listed(kind)}


def revisions(stage: Stage) -> list[dict[str, Any]]:
    return stage.listed("controllerrevisions")


def more(stage: Stage, like: dict[str, Any], *, first: int, count: int) -> None:
    """Further past specs, as that many applies would have left them."""
    bodies = []
    for number in range(first, first + count):
        metadata = {key: like["metadata"][key] for key in ("namespace", "labels", "ownerReferences")}
        data = {"spec": {**like["data"]["spec"], "schedulerName": f"s{number}"}}
        bodies.append({**like, "metadata": {**metadata, "name": f"teleop-{number}"}, "revision": number, "data": data})
    stage.plane.kubectl("create", "-f", "-", identity=USER, stdin=bodies)


def text(spec: dict[str, Any]) -> str:
    return json.dumps(spec, sort_keys=True)


def test_a_writer_of_robotapps_keeps_no_history_for_statefulsets(stage: Stage) -> None:
    """A StatefulSet makes pods of what its revisions hold: with any account of the namespace."""
    owner = {"apiVersion": "apps/v1", "kind": "StatefulSet", "name": "db", "uid": "u-1", "controller": True}
    ours = owner | {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp"}
    beside = owner | {"controller": False}
    for owners, labels in (([owner], {}), ([], {}), ([ours, beside], {}), ([ours], {"app": "db"})):
        body = {
            "apiVersion": "apps/v1",
            "kind": "ControllerRevision",
            "metadata": {"name": "db-1", "namespace": stage.namespace, "ownerReferences": owners, "labels": labels},
            "revision": 1,
            "data": {"spec": {"template": {"spec": {"serviceAccountName": "deployer"}}}},
        }
        with pytest.raises(CommandError, match="is not the past spec of a RobotApp"):
            stage.plane.kubectl("create", "-f", "-", identity=USER, stdin=body)
    body["metadata"] = {"name": "db-1", "namespace": stage.namespace, "labels": {"app": "db"}}
    stage.plane.kubectl("create", "-f", "-", stdin=body)
    with pytest.raises(CommandError, match="is not the past spec of a RobotApp"):
        stage.plane.kubectl("delete", "controllerrevision", "db-1", "-n", stage.namespace, identity=USER)
    stage.plane.kubectl("delete", "controllerrevision", "db-1", "-n", stage.namespace)


FILES = {**SAMPLES, "with-jobs": WITH_JOBS} | {
    path.parent.name: path.read_text() for path in EXAMPLES.glob("*/Rigelfile")
}
NEVER_BOUND = {"accessModes": ["ReadWriteOnce"], "storageClassName": "", "resources": {"requests": {"storage": "1Gi"}}}
LISTINGS = {path.stem.replace(".", "-"): path.read_text() for path in THESIS.glob("listing-3*.yaml")}


@pytest.fixture(scope="module")
def surroundings(stage: Stage) -> Iterator[Stage]:
    """What the samples name: the peer `mapper`, a volume claim, parameter files, the pool `lab`."""
    mapper = {"nodeName": "edge-1", "containers": [{"name": "main", "image": IMAGE}]}
    drv = {"amr-07.yaml": "/**: {ros__parameters: {v: 2.0}}"}
    for each in (
        {"kind": "Pod", "metadata": {"name": "mapper"}, "spec": mapper},
        {"kind": "ConfigMap", "metadata": {"name": "drv"}, "data": drv},
        {"kind": "PersistentVolumeClaim", "metadata": {"name": "map-pvc"}, "spec": NEVER_BOUND},
    ):
        stage.plane.kubectl("apply", "-n", stage.namespace, "-f", "-", stdin={"apiVersion": "v1", **each})
    with pool(stage.plane, "lab"):
        yield stage


NUMBERED = "every-scheduler-field"
"""The one that wants a domain by its number: it comes first, or one of the others might get that number from the pool."""


def files(folder: Path, *, domain: int) -> dict[str, list[str]]:
    """The samples as files with the flags they need, by the name of their app."""
    found = {}
    for name, text in {NUMBERED: FILES[NUMBERED], **FILES, **LISTINGS}.items():
        (folder / name).write_text(text.replace("dds_domain: 7", f"dds_domain: {domain}"))
        found[name] = [str(folder / name), "--name", name]
        if name in LISTINGS:
            found[name] += ["--image", "acme/teleop:1", *([] if "distro" in text else ["--distro", "humble"])]
    return found


def test_every_sample_becomes_ready(surroundings: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wanted = files(tmp_path, domain=90)
    for name, flags in wanted.items():
        assert surroundings.run("apply", *flags, identity="admin") == 0, capsys.readouterr().err
        assert name != NUMBERED or ready(surroundings, name), surroundings.app(name)["status"]
        assert surroundings.run("diff", *flags, identity="admin") == 0, capsys.readouterr().out
    failed = [name for name in wanted if not ready(surroundings, name)]
    assert not failed, [surroundings.app(name)["status"] for name in failed]
    surroundings.plane.kubectl("delete", "robotapps", "--all", "-n", surroundings.namespace)


def ready(stage: Stage, name: str) -> bool:
    wanted = ("--for=condition=Ready", f"robotapp/{name}", "-n", stage.namespace, "--timeout=120s")
    return "condition met" in stage.plane.kubectl("wait", *wanted, check=False)


@pytest.mark.parametrize(("form", "domain"), [("pods", 91), ("manifests", 92)])
def test_every_sample_runs_without_an_operator(
    surroundings: Stage, form: str, domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plane, where = surroundings.plane, surroundings.namespace
    numbered: list[dict[str, Any]] = []
    others: list[dict[str, Any]] = []
    for name, flags in files(tmp_path, domain=domain).items():  # an id that somebody had rests for a minute
        assert main(["render", *flags, "--format", form, "-n", where]) == 0
        (numbered if name == NUMBERED else others).extend(yaml.safe_load_all(capsys.readouterr().out))
    told = ""
    for lot in (numbered, others):
        for each in lot:
            if each["kind"] == "Deployment":  # no other scheduler runs here
                each["spec"]["template"]["spec"].setdefault("schedulerName", SCHEDULER_NAME)
        plane.kubectl("apply", "-f", "-", "--validate=strict", stdin=lot)
        wait = ("wait", "--for=condition=Available", "deployments", "--all", "-n", where, "--timeout=60s")
        told += plane.kubectl(*wait, check=False)
    pods = plane.kubectl("get", "pods", "-n", where, "-o", PENDING)
    plane.kubectl("delete", "-f", "-", "--wait=false", stdin=[*numbered, *others])
    assert "timed out" not in told, pods


PENDING = (
    'jsonpath={range .items[*]}{.metadata.name} {.status.conditions[?(@.type=="PodScheduled")].message}{"\\n"}{end}'
)


ROVER = """
def generate_launch_description():
    return LaunchDescription([
        Node(package='base_driver', executable='base_driver'),
        Node(package='operator_ui', executable='operator_ui', namespace='desk', remappings=[('cmd_vel', '/cmd_vel')]),
    ])
"""
DRIVER = """
class Driver : public rclcpp::Node { Driver() : Node("base_driver") {
  bind(socket(PF_CAN, SOCK_RAW, CAN_RAW), (sockaddr_can *)&address, sizeof(address));
  s_ = create_subscription<geometry_msgs::msg::Twist>("cmd_vel", 1, std::bind(&Driver::on, this, _1));
  t_ = create_wall_timer(50ms, [this]() { write(); }); } };
"""


def rover(root: Path) -> Path:
    """A workspace of our own: a base driver on a CAN bus, and a window that drives it."""
    cmake = "project(base_driver)\nadd_executable(base_driver src/a.cpp)\n"
    package(root, "base_driver", {"CMakeLists.txt": cmake, "src/a.cpp": DRIVER}, depends=("geometry_msgs",))
    node = python_node("operator_ui", "self.p = self.create_publisher(Twist, 'cmd_vel', 10)")
    package(root, "operator_ui", {**node, **setup_py("operator_ui")})
    package(root, "rover_bringup", {"launch/rover.launch.py": ROVER})
    return root


def test_a_launch_file_as_a_robotapp_becomes_ready_once_it_has_images(
    stage: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert profile([str(rover(tmp_path)), "--format", "robotapp", "--no-cache", "--quiet"]) == 0
    app = yaml.safe_load(capsys.readouterr().out.replace(PLACEHOLDER, IMAGE))
    app["spec"]["ros2"] = {"pool": stage.pool}
    where = ("-n", stage.namespace)
    stage.plane.kubectl("apply", "-f", "-", "--validate=strict", *where, identity=USER, stdin=app)
    assert ready(stage, "rover-bringup"), stage.app("rover-bringup")["status"]
    stored = stage.app("rover-bringup")["spec"]
    assert stored["components"][0]["devices"][0]["type"] == "can"
    assert [(edge["topic"], edge["from"], edge["to"]) for edge in stored["edges"]] == [
        ("/cmd_vel", "operator-ui", "base-driver")
    ]
    assert stage.run("delete", "rover-bringup", "--wait", "90s") == 0


def test_what_a_profile_fills_in_becomes_ready(
    stage: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = rigelfile(tmp_path, stage)
    sources = ("--profile", str(rover(tmp_path / "src")))
    assert stage.run("apply", file, *sources, "--wait", "60s") == 0, capsys.readouterr().err
    driver, window = stage.app("teleop")["spec"]["components"]
    assert (driver["qosClass"], driver["runsOn"], driver["devices"][0]["type"]) == ("realtime", ["Robot"], "can")
    assert (window["name"], window["qosClass"]) == ("operator-ui", "realtime")
    assert stage.run("diff", file, *sources) == 0, capsys.readouterr().out
    assert stage.run("delete", "teleop", "--wait", "90s") == 0


BENCHMARK = """\
application: {{distro: humble}}
jobs:
  deploy:
    plugin: rigel_bridge.RobotAppPlugin
    with:
      name: teleop
      image: acme/teleop:1
      orchestration:
        scheduler: {{policies: {{qos_class: realtime}}}}
        robotapp: {{ros2: {{pool: {pool}}}}}
sequences:
  benchmark_default: {{stages: [{{jobs: [{{name: deploy, with: {{scheduler_name: default-scheduler}}}}]}}]}}
  benchmark_custom: {{stages: [{{jobs: [{{name: deploy, with: {{scheduler_name: kubernetes-scheduler}}}}]}}]}}
"""
OLD = "scheduler.robotics.io/"


def test_two_schedulers_are_compared_and_nothing_is_left(
    stage: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "Rigelfile").write_text(BENCHMARK.format(pool=stage.pool))
    wanted = ("--run", "benchmark_default", "benchmark_custom", "--duration", "0s", "--results", str(tmp_path / "r"))
    with HandBinder(stage.plane, stage.namespace):  # the default scheduler does not run here
        assert stage.run("sequences", str(tmp_path / "Rigelfile"), *wanted) == 0, capsys.readouterr().err
    runs = {each["sequence"]: each for each in read_summaries(tmp_path / "r")}
    assert {name: run["scheduler"] for name, run in runs.items()} == {
        "benchmark_default": "default-scheduler",
        "benchmark_custom": "kubernetes-scheduler",
    }
    assert all(run["components"][0]["ready"] and run["components"][0]["node"] for run in runs.values())
    assert "| node of ros-app |" in capsys.readouterr().out
    eventually(lambda: not left(stage, "teleop-benchmark"), what=lambda: left(stage, "teleop-benchmark"))


def test_a_killed_run_is_told_from_a_living_one_and_cleared_by_the_next(
    stage: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "Rigelfile").write_text(BENCHMARK.format(pool=stage.pool))
    name, arguments = "teleop-benchmark-custom", [str(tmp_path / "Rigelfile"), "--run", "benchmark_custom"]
    command = [sys.executable, "-m", "rigel_bridge.main", "sequences", *arguments, "--duration", "1h"]
    command += ["--results", str(tmp_path / "a"), "-n", stage.namespace, *stage.cluster(USER)]
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        first = eventually(lambda: renewal(stage, name), what="no app of a run")
        eventually(lambda: renewal(stage, name) != first, what="the run does not renew its lease")
        assert stage.run("sequences", *arguments, "--results", str(tmp_path / "b")) == 74
        assert "is of a run that goes on" in capsys.readouterr().err
        stage.run("status", name)
        assert "run of sequence benchmark_custom goes on" in capsys.readouterr().out
    finally:
        running.kill()
        running.wait()
    found, _ = lease.state(stage.app(name), datetime.now(tz=UTC) + timedelta(seconds=lease.LEASE_S + 1))
    assert found is lease.State.LOST
    assert [each["outcome"] for each in read_summaries(tmp_path / "a")] == ["unfinished"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lease, "LEASE_S", 1.0)  # nothing renews it any more: the test need not wait for 40 s
        wanted = ("--duration", "0s", "--results", str(tmp_path / "c"))
        assert stage.run("sequences", *arguments, *wanted) == 0, capsys.readouterr().err
    eventually(lambda: not left(stage, name), what=lambda: left(stage, name))


def renewal(stage: Stage, name: str) -> str:
    """When the run of an app was last renewed; empty while there is no such app."""
    found = [item for item in stage.apps() if item["metadata"]["name"] == name]
    return found[0]["metadata"]["annotations"][lease.RENEWED] if found else ""


def left(stage: Stage, name: str) -> list[str]:
    """What is there of apps whose names begin so. The user may not list pods, so the run did not wait for theirs."""
    found = [item["metadata"]["name"] for item in stage.listed("robotapps,pods,deployments,controllerrevisions")]
    return [each for each in found if each.startswith(name)]


def annotated(name: str) -> dict[str, Any]:
    """A Deployment as Rigel's orchestration plugin made it for the thesis' scheduler."""
    annotations = {f"{OLD}policies": '{"latency_budget":"90ms","qos_class":"realtime"}', f"{OLD}dds-domain": "auto"}
    template = {
        "metadata": {"labels": {"app": name}, "annotations": annotations},
        "spec": {
            "schedulerName": "kubernetes-scheduler",
            "containers": [{"name": "ros-app", "image": f"{IMAGE}-humble"}],
        },
    }
    spec = {"replicas": 1, "selector": {"matchLabels": {"app": name}}, "template": template}
    return {"apiVersion": "apps/v1", "kind": "Deployment", "metadata": {"name": name}, "spec": spec}


def test_a_deployment_of_the_thesis_is_taken_over_with_its_records(
    stage: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plane, where = stage.plane, stage.namespace
    plane.kubectl("apply", "-n", where, "-f", "-", stdin=annotated("arm"))
    plane.kubectl("rollout", "status", "deployment/arm", "-n", where, "--timeout=60s")
    (pod,) = json.loads(plane.kubectl("get", "pods", "-l", "app=arm", "-n", where, "-o", "json"))["items"]
    uid, node = pod["metadata"]["uid"], pod["spec"]["nodeName"]
    record = json.dumps({"5": uid, "6": "of-another-namespace"})
    plane.kubectl(
        "annotate", "node", node, f"{OLD}dds-claims={record}", f"{OLD}device-claims={json.dumps({'can': uid})}"
    )

    assert stage.run("migrate", identity="admin") == 0
    shown = capsys.readouterr()
    (app,) = yaml.safe_load_all(shown.out)
    assert app["spec"]["components"][0]["policies"] == {"latencyBudget": "90ms"}
    assert f"domain 5 held by pod {uid} of deployment {where}/arm" in shown.err

    backup = tmp_path / "old"
    assert stage.run("migrate", "--apply", "--backup", str(backup), identity="admin") == 0, capsys.readouterr().err
    assert "arm: Ready, in place of" in capsys.readouterr().out
    assert not plane.kubectl("get", "deployment", "arm", "-n", where, "--ignore-not-found")
    notes = json.loads(plane.kubectl("get", "node", node, "-o", "json"))["metadata"]["annotations"]
    assert json.loads(notes[f"{OLD}dds-claims"]) == {"6": "of-another-namespace"}
    assert f"{OLD}device-claims" not in notes
    assert json.loads((backup / "deployment-arm.json").read_text())["metadata"]["name"] == "arm"
    assert stage.run("migrate") == 0, f"{USER} may list no workloads: told, and nothing is found"
    assert stage.run("delete", "arm", identity="admin") == 0


def speaking(name: str, distro: str, domain: str) -> dict[str, Any]:
    """A Deployment of the thesis' time without records, in a domain that its pods state themselves."""
    old = annotated(name)
    template = old["spec"]["template"]
    template["metadata"].pop("annotations")
    template["spec"]["containers"][0] |= {
        "image": f"{IMAGE}-{distro}",
        "env": [{"name": "ROS_DOMAIN_ID", "value": domain}],
    }
    return old


def test_workloads_that_met_are_taken_over_together_and_meet_in_their_domain(
    stage: Stage, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plane, where, domain = stage.plane, stage.namespace, "89"
    old = {"talker": "humble", "hearer": "humble", "viewer": "jazzy"}
    for name, distro in old.items():
        plane.kubectl("apply", "-n", where, "-f", "-", stdin=speaking(name, distro, domain))
    for name in old:
        plane.kubectl("rollout", "status", f"deployment/{name}", "-n", where, "--timeout=60s")
    backup = tmp_path / "old"
    asked = ("migrate", "--apply", "--backup", str(backup), *old)
    assert stage.run(*asked, identity="admin") == Exit.INVALID
    assert "APART: deployment" in capsys.readouterr().err, "two distributions do not find each other by multicast"
    assert stage.run(*asked, "--lossy", identity="admin") == 0, capsys.readouterr().err

    apps = {app["metadata"]["name"]: app["spec"] for app in stage.apps() if app["metadata"]["name"] in old}
    names = sorted(sorted(each["name"] for each in spec["components"]) for spec in apps.values())
    assert names == [["hearer", "talker"], ["viewer"]], "two distributions are two apps"
    assert any(spec["ros2"].get("shareWith") for spec in apps.values())
    pods = [pod for pod in stage.listed("pods") if pod["metadata"]["labels"].get("robotics.io/component") in old]
    variables = [{each["name"]: each.get("value") for each in pod["spec"]["containers"][0]["env"]} for pod in pods]
    assert [each["ROS_DOMAIN_ID"] for each in variables] == [domain] * 3
    assert sorted(path.name for path in backup.iterdir() if path.name.startswith("deployment-")) == [
        f"deployment-{name}.json" for name in sorted(old)
    ]
    for name in apps:
        assert stage.run("delete", name, identity="admin") == 0
        stage.gone(name)
