"""Our kinds on the real API server: what is stored, shown, selected and refused."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
import yaml
from tests.support import crds
from tests.support.apiobjects import (
    AMR_07,
    app,
    claim,
    component,
    device,
    domain,
    edge,
    holder,
    instance,
    pool,
    telemetry,
)
from tests.support.schemas import with_defaults

from robotapp_api.model.app.robotapp import RobotApp
from robotapp_api.model.base import Model
from robotapp_api.model.claim import RobotClaim
from robotapp_api.model.conditions import initial_conditions
from robotapp_api.model.instance import RobotAppInstance
from robotapp_api.model.pool import DomainPool
from robotapp_api.model.telemetry import NodeTelemetry
from robotapp_api.schema.crd import schema_of
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.api import APPLY
from robotapp_testbed.failures import ApiStatusError

pytestmark = pytest.mark.live

SAMPLES: list[tuple[type[Model], dict[str, Any]]] = [
    (RobotApp, app("minimal", components=[component()])),
    (
        RobotApp,
        app(
            "full",
            robots=AMR_07,
            ros2={"shareWith": [{"name": "other"}]},
            components=[
                component(
                    devices=[{"name": "bus", "type": "can"}],
                    requires=[{"type": "gpu"}],
                    parameters=[{"configMapKeyRef": {"name": "p", "key": "params.yaml"}}],
                ),
                component("operator", ready={"topic": {"name": "/odom"}}, policies={"deadline": "50ms"}),
            ],
            edges=[edge(latency={"budget": "30ms"})],
        ),
    ),
    (RobotClaim, claim("dds.samples.c.7", domain=domain(pool="samples"))),
    (RobotAppInstance, instance("samples")),
    (DomainPool, pool("samples")),
    (NodeTelemetry, {key: value for key, value in telemetry("sample-node").items() if key != "status"}),
]


@pytest.fixture(autouse=True)
def _deleted(control_plane: ControlPlane) -> Iterator[None]:
    """No operator shall meet the objects made here."""
    yield
    control_plane.api.delete(crds.collection("RobotApp"))
    control_plane.api.delete(crds.collection("RobotAppInstance"))
    control_plane.api.delete(crds.collection("RobotClaim"))
    control_plane.api.delete(crds.collection("NodeTelemetry"))


def create(plane: ControlPlane, obj: dict[str, Any], options: str = "?fieldValidation=Strict") -> Any:
    return plane.api.create(crds.collection(obj["kind"]) + options, obj)


def set_status(plane: ControlPlane, obj: dict[str, Any], status: dict[str, Any]) -> Any:
    return plane.api.patch(crds.address(obj) + "/status", {"status": status})


@pytest.mark.parametrize(
    ("model", "obj"), SAMPLES, ids=lambda value: value["metadata"]["name"] if isinstance(value, dict) else ""
)
def test_stored_objects_show_the_defaults_and_the_model_reads_both_alike(
    control_plane: ControlPlane, model: type[Model], obj: dict[str, Any]
) -> None:
    stored = create(control_plane, obj, "?dryRun=All&fieldValidation=Strict")
    expected = with_defaults(schema_of(model), obj)
    assert {key: stored.get(key) for key in ("spec", "status")} == {
        key: expected.get(key) for key in ("spec", "status")
    }
    unlike: dict[str, Any] = {"metadata": {}}
    assert model.model_validate(obj | unlike) == model.model_validate(stored | unlike)


def test_a_new_app_is_pending_with_seven_unknown_conditions(control_plane: ControlPlane) -> None:
    status = create(control_plane, app(), "?dryRun=All")["status"]
    assert status["phase"] == "Pending"
    assert [condition["type"] for condition in status["conditions"]] == [each.type for each in initial_conditions()]


def test_kubectl_shows_the_columns(control_plane: ControlPlane) -> None:
    obj = app("columns")
    create(control_plane, obj)
    summary = {
        "ready": "3/3",
        "domain": "7-9",
        "robots": "1/1",
        "budget": "18/30ms",
        "devices": "2/2",
        "rmw": "rmw_zenoh_cpp",
    }
    set_status(control_plane, obj, {"phase": "Running", "summary": summary})
    table = control_plane.kubectl("get", "ra", "columns").splitlines()
    assert table[0].split() == ["NAME", "READY", "PHASE", "DOMAIN", "ROBOTS", "BUDGET", "DEVICES", "AGE"]
    assert table[1].split()[:7] == ["columns", "3/3", "Running", "7-9", "1/1", "18/30ms", "2/2"]
    wide = control_plane.kubectl("get", "rapp", "columns", "-o", "wide").splitlines()
    assert wide[0].split()[8:] == ["RMW", "DISCOVERY", "NODES", "MESSAGE"]
    assert "columns" in control_plane.kubectl("get", "robotics", "-A")


def test_instances_show_their_app_and_their_robot(control_plane: ControlPlane) -> None:
    obj = instance("columns-amr-07")
    create(control_plane, obj)
    summary = {"ready": "3/3", "budget": "18/30ms", "devices": "2/2", "nodes": "amr-07,edge-1"}
    set_status(control_plane, obj, {"phase": "Running", "summary": summary, "domain": 7})
    table = control_plane.kubectl("get", "rai", "columns-amr-07").splitlines()
    columns = ["NAME", "APP", "ROBOT", "READY", "PHASE", "DOMAIN", "BUDGET", "DEVICES", "NODES", "AGE"]
    assert table[0].split() == columns
    row = ["columns-amr-07", "teleop", "amr-07", "3/3", "Running", "7", "18/30ms", "2/2", "amr-07,edge-1"]
    assert table[1].split()[:9] == row
    selected = control_plane.api.get(f"{crds.collection('RobotAppInstance')}?fieldSelector=spec.appUID=u-1")
    assert "columns-amr-07" in {each["metadata"]["name"] for each in selected["items"]}


def test_claims_show_their_thing_and_holder(control_plane: ControlPlane) -> None:
    obj = claim("dev.n0123456789.columns", device=device(id="columns"), holder=holder(instance="amr-07"))
    obj["metadata"]["annotations"] = {"robotics.io/thing": "can0 on amr-07", "robotics.io/holder": "default/teleop"}
    create(control_plane, obj)
    header, row = control_plane.kubectl("get", "robotclaims", obj["metadata"]["name"]).splitlines()
    assert header.split() == ["NAME", "HOLDERKIND", "THING", "HOLDER", "INSTANCE", "NODE", "PHASE", "AGE"]
    assert row.split()[1:9] == ["RobotApp", "can0", "on", "amr-07", "default/teleop", "amr-07", "amr-07", "Reserved"]


def test_every_field_has_an_explain_text(control_plane: ControlPlane) -> None:
    document = control_plane.api.get("/openapi/v3/apis/robotics.io/v1alpha1")
    kinds = {
        name: schema for name, schema in document["components"]["schemas"].items() if name.startswith("io.robotics")
    }
    checked = sum(_count_described(schema, name) for name, schema in kinds.items())
    assert checked > 700


@pytest.mark.parametrize(
    ("field", "text"),
    [
        ("robotapp.spec.edges.latency.budget", "Round-trip time the nodes of the two ends may have between them"),
        ("robotapp.spec.components.runsOn", "Tiers of nodes the component may run on, best first"),
        ("robotapp.spec.components.template.spec.nodeName", "Refused: a pod with a node never meets the scheduler"),
        ("robotapp.spec.components.livenessProbe.periodSeconds", "How often (in seconds) to perform the probe"),
        ("robotapp.status.troubled.reason", "Word for programs"),
        ("rai.status.edges.p95", "Round-trip time between the two nodes, 95th percentile"),
        ("domainpool.spec.quota.default", "absent means no limit, 0 means none"),
    ],
)
def test_kubectl_explains_a_field(control_plane: ControlPlane, field: str, text: str) -> None:
    assert text in " ".join(control_plane.kubectl("explain", field).split())


def test_kubectl_lists_the_fields_of_an_app_for_somebody_who_writes_the_first_one(control_plane: ControlPlane) -> None:
    tree = control_plane.kubectl("explain", "robotapp.spec", "--recursive")
    for wanted in ("distro", "nodeSelector", "minRate", "configMapKeyRef", "preStop", "sharing"):
        assert re.search(rf"^ +{wanted}\t", tree, re.MULTILINE), wanted
    assert re.search(r"^ +distro\t<string> -required-$", tree, re.MULTILINE)


def _count_described(schema: dict[str, Any], path: str) -> int:
    count = 0
    for key, member in schema.get("properties", {}).items():
        assert member.get("description") or key == "metadata", f"{path}.{key}"
        inner = member.get("items", member)
        count += 1 + _count_described(inner, f"{path}.{key}")
    return count


@pytest.mark.parametrize(
    ("field", "where"),
    [
        ({"latencyBudgt": "30ms"}, "latencyBudgt"),
        ({"ports": [{"containerPort": 1, "hostIP": "192.0.2.1"}]}, "hostIP"),
        ({"template": {"spec": {"volumes": [{"name": "v", "gitRepo": {"repository": "x"}}]}}}, "gitRepo"),
        ({"resources": {"claims": [{"name": "gpu"}]}}, "claims"),
        ({"template": {"spec": {"setHostnameAsFQDN": True}}}, "setHostnameAsFQDN"),
        ({"template": {"metadata": {"namespace": "other"}}}, "namespace"),
    ],
)
def test_unknown_and_withheld_fields_are_refused_or_pruned(
    control_plane: ControlPlane, field: dict[str, Any], where: str
) -> None:
    obj = app(components=[component(**field)])
    with pytest.raises(ApiStatusError, match="unknown field") as refused:
        create(control_plane, obj, "?dryRun=All&fieldValidation=Strict")
    assert where in refused.value.message
    pruned = create(control_plane, obj, "?dryRun=All&fieldValidation=Ignore")
    assert where not in str(pruned["spec"])


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ({"components": []}, "should have at least 1 items"),
        ({"components": [component("Driver")]}, "should match"),
        ({"components": [component(runsOn=["Boat"])]}, 'supported values: "Robot", "Edge", "Cloud"'),
        ({"ros": {}}, "spec.ros.distro: Required value"),
        ({"ros2": {"domain": 233}}, "less than or equal to 232"),
        ({"ros2": {"rmw": "fastrtps"}}, "spec.ros2.rmw"),
        ({"placement": {"fallback": {"steps": ["Onboard"]}}}, 'supported values: "RelaxPreferred", "Wait"'),
        (
            {"connectivity": {"grace": "5 minutes"}},
            'spec.connectivity.grace: Invalid value: "5 minutes": write a number and a unit (us, ms, s, m or h)',
        ),
        ({"edges": [edge(), edge()]}, "Duplicate value"),
    ],
)
def test_values_out_of_bounds_are_refused_with_the_field_and_what_is_allowed(
    control_plane: ControlPlane, spec: dict[str, Any], message: str
) -> None:
    with pytest.raises(ApiStatusError) as refused:
        create(control_plane, app(**spec), "?dryRun=All")
    assert message in refused.value.message


def test_server_side_apply_merges_lists_by_their_keys(control_plane: ControlPlane) -> None:
    address = crds.address(app("merged"))
    gitops = app("merged", components=[component("operator"), component("driver")], edges=[edge()])
    tuner = app(
        "merged", components=[component("driver", qosClass="realtime")], edges=[edge(latency={"budget": "30ms"})]
    )
    del tuner["spec"]["components"][0]["image"]
    control_plane.api.patch(f"{address}?fieldManager=gitops", gitops, content_type=APPLY)
    merged = control_plane.api.patch(f"{address}?fieldManager=tuner", tuner, content_type=APPLY)
    assert {each["name"]: each["qosClass"] for each in merged["spec"]["components"]} == {
        "operator": "system_default",
        "driver": "realtime",
    }
    assert merged["spec"]["edges"][0]["latency"]["budget"] == "30ms"
    again = control_plane.api.patch(f"{address}?fieldManager=tuner", tuner, content_type=APPLY)
    assert again["metadata"]["resourceVersion"] == merged["metadata"]["resourceVersion"]


def test_two_writers_own_different_conditions(control_plane: ControlPlane) -> None:
    obj = app("conditions")
    create(control_plane, obj)
    for manager, kind in (("robotapp-operator", "Ready"), ("robotapp-scheduler", "Placed")):
        condition = (
            initial_conditions()[0].model_copy(update={"type": kind, "status": "True"}).model_dump(exclude_none=True)
        )
        body = obj | {"spec": None, "status": {"conditions": [condition]}}
        del body["spec"]
        path = f"{crds.address(obj)}/status?fieldManager={manager}&force=true"
        status = control_plane.api.patch(path, body, content_type=APPLY)["status"]
    assert {each["type"]: each["status"] for each in status["conditions"] if each["status"] == "True"} == {
        "Ready": "True",
        "Placed": "True",
    }
    assert len(status["conditions"]) == 7


def test_status_changes_only_through_its_own_path(control_plane: ControlPlane) -> None:
    obj = app("statuspath")
    created = create(control_plane, obj | {"status": {"phase": "Running"}})
    assert created["status"]["phase"] == "Pending"
    after = set_status(control_plane, obj, {"phase": "Running"})
    assert (after["status"]["phase"], after["metadata"]["generation"]) == ("Running", created["metadata"]["generation"])


def test_a_status_of_a_newer_operator_is_accepted(control_plane: ControlPlane) -> None:
    obj = app("newphase")
    create(control_plane, obj)
    assert set_status(control_plane, obj, {"phase": "Hibernating"})["status"]["phase"] == "Hibernating"


@pytest.mark.parametrize(
    ("selector", "names"),
    [
        ("spec.holder.uid=u-a", {"dds.sel.c.1", "dev.n0123456789.sel-b"}),
        ("spec.holder.uid=u-a,spec.holder.instance=amr-07", {"dds.sel.c.1"}),
        ("spec.holder.namespace=team-b", {"dds.sel.c.2"}),
        ("spec.domain.pool=sel", {"dds.sel.c.1", "dds.sel.c.2"}),
        ("spec.device.node=sel-node", {"dev.n0123456789.sel-b"}),
        ("spec.domain.pool=sel,status.phase=Draining", {"dds.sel.c.2"}),
        ("spec.domain.pool=sel,status.phase=Reserved", {"dds.sel.c.1"}),
    ],
)
def test_claims_are_selected_by_fields_nobody_can_change(
    control_plane: ControlPlane, selector: str, names: set[str]
) -> None:
    objects = [
        claim("dds.sel.c.1", domain=domain(pool="sel", id=1), holder=holder(uid="u-a", instance="amr-07")),
        claim("dds.sel.c.2", domain=domain(pool="sel", id=2), holder=holder(uid="u-b", namespace="team-b")),
        claim("dev.n0123456789.sel-b", device=device(node="sel-node", id="sel-b"), holder=holder(uid="u-a")),
    ]
    for obj in objects:
        create(control_plane, obj)
    set_status(control_plane, objects[1], {"phase": "Draining"})
    found = control_plane.api.get(f"{crds.collection('RobotClaim')}?fieldSelector={selector}")
    assert {each["metadata"]["name"] for each in found["items"]} == names


def test_telemetry_lists_are_written_as_a_whole(control_plane: ControlPlane) -> None:
    obj = telemetry("bounds")
    create(control_plane, {key: value for key, value in obj.items() if key != "status"})
    rtt = [
        {"peer": f"node-{number}", "p50Us": 900, "p95Us": 2100, "lossPPM": 5000, "seq": 3, "everyRounds": 4}
        for number in range(64)
    ]
    status = {"intervalSeconds": 10, "seq": 1, "kernel": {"realtime": True}, "rtt": rtt, "load": {"cpuPercent": 12}}
    assert set_status(control_plane, obj, status)["status"]["rtt"] == rtt
    with pytest.raises(ApiStatusError, match="must have at most 64 items"):
        set_status(control_plane, obj, {"rtt": [*rtt, {"peer": "one-more"}]})


@pytest.mark.parametrize("path", crds.EXAMPLES, ids=lambda path: path.name)
def test_examples_are_accepted_by_server_and_model(control_plane: ControlPlane, path: Any) -> None:
    for obj in yaml.safe_load_all(path.read_text()):
        obj["metadata"]["namespace"] = "default"
        create(control_plane, obj, "?dryRun=All&fieldValidation=Strict")
        assert RobotApp.model_validate(obj).metadata.name == obj["metadata"]["name"]
