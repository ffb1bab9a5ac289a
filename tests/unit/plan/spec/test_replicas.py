"""Replicas with ordinals: each is a component of its own, with names that stay when their number changes."""

from collections.abc import Mapping
from typing import Any

import msgspec
import pytest
from tests.support.factories import UID, VERSION, after, component, make_app

from robotapp_api.model.names import Label, Reason
from robotapp_operator.plan.diff.diff import Observed, Plan, plan, wanted_children
from robotapp_operator.plan.diff.scaled import note_scaled
from robotapp_operator.plan.render.child import DEPLOYMENT, SERVICE, Child
from robotapp_operator.plan.spec.config_content import list_config_maps
from robotapp_operator.plan.spec.dependencies import unmet_dependencies
from robotapp_operator.plan.spec.desired import App, Domain, desired_of
from robotapp_operator.plan.spec.links import LinkView, list_links
from robotapp_operator.plan.spec.objects import ChildRef, Service
from robotapp_operator.plan.spec.robot_values import overridden
from robotapp_operator.plan.spec.validate import notes_of, problems_alone

RUN = {"package": "p", "executable": "e", "name": "detector"}
CAMERA = {"name": "cam", "type": "video"}


def detectors(replicas: int = 3, **fields: Any) -> dict[str, Any]:
    return component("det", replicas=replicas, replicaIdentity="Ordinal", **{"run": RUN} | fields)


def list_children(app: App, robot: str = "") -> dict[ChildRef, Child]:
    wanted = wanted_children(desired_of(app, robot), domain=Domain(7), parameters={}, running=not app.spec.suspend)
    return {child.ref: child for child in wanted}


def deployments_of(app: App, robot: str = "") -> dict[str, Child]:
    children = list_children(app, robot).values()
    return {child.component: child for child in children if child.ref.kind == DEPLOYMENT and child.component}


def look(app: App, observed: Mapping[ChildRef, Observed]) -> Plan:
    return plan(app, list(list_children(app).values()), observed, version=VERSION, settled={})


def pod_of(child: Child) -> dict[str, Any]:
    return dict(child.spec["template"]["spec"])


def env_of(child: Child) -> dict[str, str]:
    return {item["name"]: item.get("value", "") for item in pod_of(child)["containers"][0]["env"]}


def test_each_replica_has_a_deployment_of_one_pod_with_its_names() -> None:
    app = make_app(component("operator"), detectors())
    children = deployments_of(app)
    assert list(children) == ["operator", "det-0", "det-1", "det-2"]
    service = desired_of(app, "").replicas_service("det-0")
    for ordinal in range(3):
        child = children[f"det-{ordinal}"]
        assert child.spec["replicas"] == 1
        assert child.spec["strategy"] == {"type": "Recreate"}
        assert (pod_of(child)["hostname"], pod_of(child)["subdomain"]) == (f"det-{ordinal}", service)
        assert env_of(child)["ROBOTAPP_COMPONENT"] == "det"
        assert env_of(child)["ROBOTAPP_ORDINAL"] == str(ordinal)
        assert env_of(child)["ROBOTAPP_REPLICAS_SERVICE"] == service
        assert f"__node:=detector_{ordinal}" in pod_of(child)["containers"][0]["args"]
        assert child.labels[Label.REPLICA_OF] == "det"
    names = list_children(app)[ChildRef(SERVICE, service)].spec
    assert names["clusterIP"] == "None"
    assert names["publishNotReadyAddresses"]
    labels = children["det-1"].spec["template"]["metadata"]["labels"]
    assert names["selector"].items() <= labels.items()
    assert not names["selector"].items() <= children["operator"].labels.items()


def test_with_peers_the_replicas_have_their_names_among_the_peers() -> None:
    app = make_app(component("operator"), detectors(2), ros={"distro": "jazzy"}, ros2={"rmw": "rmw_cyclonedds_cpp"})
    desired = desired_of(app, "")
    assert [name.partition(".")[0] for name in desired.peer_names] == ["operator", "det-0", "det-1"]
    assert {ref.name for ref in list_children(app) if ref.kind == SERVICE} == {desired.peers_service}
    child = deployments_of(app)["det-1"]
    assert (pod_of(child)["hostname"], pod_of(child)["subdomain"]) == ("det-1", desired.peers_service)
    assert env_of(child)["ROBOTAPP_REPLICAS_SERVICE"] == desired.peers_service


def test_fewer_replicas_end_those_with_the_highest_ordinals_and_leave_the_rest_alone() -> None:
    three = make_app(component("operator"), detectors(3))
    observed = after(look(three, {}), {}, three)
    assert not look(three, observed)
    two = make_app(component("operator"), detectors(2), generation=2)
    planned = look(two, observed)
    assert [item.metadata.labels[Label.COMPONENT] for item in planned.deletes] == ["det-2"]
    assert not planned.changes
    again = look(make_app(component("operator"), detectors(4), generation=3), observed)
    assert [change.child.component for change in again.changes] == ["det-3"]
    assert not again.deletes


def test_replicas_0_suspends_the_first_and_ends_the_rest() -> None:
    app = make_app(component("operator"), detectors(2))
    observed = after(look(app, {}), {}, app)
    none = make_app(component("operator"), detectors(0), generation=2)
    planned = look(none, observed)
    assert [item.metadata.labels[Label.COMPONENT] for item in planned.deletes] == ["det-1"]
    assert [(change.child.component, change.child.spec["replicas"]) for change in planned.changes] == [("det-0", 0)]
    assert make_app(detectors(0)).suspended


def test_the_number_of_replicas_is_no_edit_of_other_components() -> None:
    """Templates that wait for approval of a newer operator would roll because of it."""
    two, three = (make_app(component("operator"), detectors(count)).spec_hashes for count in (2, 3))
    assert two["operator"] == three["operator"]
    assert two["det-0"] == three["det-0"]
    assert two[""] == three[""]
    assert make_app(component("operator"), {**detectors(2), "image": "x:2"}).spec_hashes["det-0"] == two["det-0"]
    assert make_app(component("operator"), detectors(2, workingDir="/x")).spec_hashes["det-0"] != two["det-0"]


def test_references_to_the_component_are_to_each_replica() -> None:
    waiting = component("operator", dependsOn=[{"component": "det"}], colocateWith=["det"])
    app = make_app(waiting, detectors(2), edges=[{"topic": "/a", "from": "det", "to": "operator"}])
    assert [(edge.from_, edge.to) for edge in app.spec.edges] == [("det-0", "operator"), ("det-1", "operator")]
    assert app.spec.components[0].colocate_with == ("det-0", "det-1")
    assert unmet_dependencies(app, []) == {"operator": ("det-0", "det-1")}
    assert [edge.from_ for edge in app.written.edges] == ["det"]


def test_overrides_are_for_all_replicas() -> None:
    override = {
        "name": "some",
        "nodeSelector": {"matchLabels": {"a": "b"}},
        "components": [{"name": "det", "image": "reg/other:1"}],
    }
    robots = {"nodeSelector": {"matchLabels": {"robotics.io/robot": "amr-07"}}}
    app = make_app(component("operator"), detectors(2), robots=robots, overrides=[override])
    of_robot = overridden(app, {"det-0": ("some",), "det-1": ("some",)})
    assert [part.image for part in of_robot.spec.components] == ["reg/operator:1", "reg/other:1", "reg/other:1"]
    assert of_robot.written is app.written


def test_one_service_and_its_links_are_for_all_replicas() -> None:
    service = {"spec": {"ports": [{"name": "http", "port": 80}]}, "links": [{"name": "page", "port": "http"}]}
    app = make_app(component("operator"), detectors(2, service=service))
    desired = desired_of(app, "")
    child = list_children(app)[ChildRef(SERVICE, desired.name_of("det"))]
    assert child.body(app, version=VERSION)["spec"]["selector"][Label.REPLICA_OF] == "det"
    owner = {"ownerReferences": [{"uid": UID, "controller": True}], "labels": {Label.APP_UID.value: UID}}
    spec = {"type": "NodePort", "ports": [{"name": "http", "port": 80, "nodePort": 30080}]}
    stored = {"metadata": {"name": child.ref.name, "namespace": "default", **owner}, "spec": spec}
    services = {child.ref.name: msgspec.convert(stored, Service)}
    links = list_links(desired, services, {"operator": "far", "det-1": "edge-1"}, lambda node: node)
    assert links == (LinkView("det", "page", "http://edge-1:30080"),)


def test_the_ordinal_stands_in_names_of_objects_labels_paths_and_programs() -> None:
    template = {
        "metadata": {"labels": {"lane": "l-$(ROBOTAPP_ORDINAL)"}},
        "spec": {"volumes": [{"name": "d", "persistentVolumeClaim": {"claimName": "data-$(ROBOTAPP_ORDINAL)"}}]},
    }
    part = detectors(
        2,
        template=template,
        run={**RUN, "namespace": "/lane$(ROBOTAPP_ORDINAL)", "args": ["--lane=$(ROBOTAPP_ORDINAL)"]},
        envFrom=[{"configMapRef": {"name": "env-$(ROBOTAPP_ORDINAL)"}}],
        volumeMounts=[{"name": "d", "mountPath": "/d", "subPath": "$(ROBOTAPP_ORDINAL)"}],
    )
    app = make_app(part)
    assert problems_alone(app) == ()
    child = deployments_of(app)["det-1"]
    container = pod_of(child)["containers"][0]
    assert child.spec["template"]["metadata"]["labels"]["lane"] == "l-1"
    assert pod_of(child)["volumes"][0]["persistentVolumeClaim"]["claimName"] == "data-1"
    assert container["volumeMounts"][0]["subPath"] == "1"
    assert container["args"][4] == "--lane=1"
    assert "__ns:=/lane1" in container["args"]
    assert "__node:=detector" in container["args"], "the namespace has the ordinal already"
    assert list_config_maps(app, "") == {"default/env-0", "default/env-1"}


@pytest.mark.parametrize(
    ("parts", "field", "words"),
    [
        ((detectors(2), component("det-7")), "spec.components[0].replicaIdentity", "has the name of a replica of det"),
        ((detectors(2, template={"spec": {"hostname": "h"}}),), "spec.components[0].template.spec.hostname", "remove"),
        ((component("a", args=["$(ROBOTAPP_ORDINAL)"]),), "spec.components[0].args", "replicaIdentity: Ordinal"),
        (
            (component("a", template={"metadata": {"labels": {"x": "$(ROBOTAPP_ORDINAL)"}}}),),
            'spec.components[0].template.metadata.labels["x"]',
            "replicaIdentity: Ordinal",
        ),
        (
            (detectors(2, template={"spec": {"imagePullSecrets": [{"name": "s-$(ROBOTAPP_ORDINAL)"}]}}),),
            "spec.components[0].template.spec.imagePullSecrets[0].name",
            "in common",
        ),
        (
            (detectors(32), *(component(f"c{number}") for number in range(40))),
            "spec.components",
            "has 72 components, and at most 64 are allowed",
        ),
        ((component("a", colocateWith=["det"]), detectors(9)), "spec.components", "colocateWith is not allowed"),
    ],
)
def test_what_cannot_be_with_ordinals_is_refused_with_the_cure(parts: Any, field: str, words: str) -> None:
    (problem,) = problems_alone(make_app(*parts))
    assert problem.field == field
    assert words in problem.message


def test_too_many_edges_between_replicas_are_refused() -> None:
    part = component("map", replicas=20, replicaIdentity="Ordinal", run=RUN)
    app = make_app(detectors(20), part, edges=[{"topic": "/a", "from": "det", "to": "map"}])
    (problem,) = problems_alone(app)
    assert (problem.field, "has 400 edges" in problem.message) == ("spec.edges", True)


def test_replicas_that_are_too_large_together_are_refused_and_not_made() -> None:
    """A spec of a megabyte with 32 replicas would be 32 of them in the operator's memory."""
    env = [{"name": f"V{number}", "value": "x" * 20_000} for number in range(5)]
    app = make_app(detectors(32, env=env))
    (problem,) = problems_alone(app)
    assert (problem.reason, problem.field) == (Reason.TOO_LARGE, "spec.components")
    assert len(app.spec.components) == 1


def test_a_program_without_a_name_of_each_replicas_own_is_noted() -> None:
    def list_notes(**fields: Any) -> list[str]:
        return list(notes_of(make_app(component("det", replicas=2, replicaIdentity="Ordinal", **fields))))

    assert list_notes(run=RUN) == []
    assert list_notes(args=["ros2", "run", "p", "e", "--ros-args", "-r", "__node:=d_$(ROBOTAPP_ORDINAL)"]) == []
    (note,) = list_notes(run={"package": "p", "executable": "e"})
    assert "write run.name, or a name with $(ROBOTAPP_ORDINAL)" in note


def test_what_scaled_a_replica_is_told_the_field_of_its_component() -> None:
    app = make_app(component("operator"), detectors(2))
    observed = after(look(app, {}), {}, app)
    child = deployments_of(app)["det-1"]
    over = observed[child.ref]
    scaled = write_spec(over, replicas=4)
    assert "write spec.components[1].replicas of RobotApp teleop" in note_scaled(app, child, scaled, [])


def write_spec(over: Observed, **spec: Any) -> Observed:
    return type(over)(metadata=over.metadata, given={**over.spec, **spec})


def test_an_app_without_ordinals_is_the_one_that_was_written() -> None:
    app = make_app(component("operator", replicaIdentity="None"), component("driver", replicas=2))
    assert app.written is app.spec
    assert app.replicas == {}
