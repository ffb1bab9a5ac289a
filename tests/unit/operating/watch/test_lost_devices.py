"""What an instance holds, and what it has lost, while its node is silent or its pod is replaced."""

import json
from typing import Any

import msgspec
import pytest
from tests.support.claims.objects import device_claim
from tests.support.factories import UID, app_body, make_node

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.identity import holder_of_app
from robotapp_claims.rules.instances import Instance
from robotapp_client.api.times import utc_now
from robotapp_operator.plan.spec.objects import Deployment, Pod, Telemetry
from robotapp_operator.plan.status.facts import InstanceFacts
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.facts.instance_facts import instance_facts

LABELS = {Label.APP_UID.value: UID, Label.INSTANCE.value: "", Label.COMPONENT.value: "driver"}
HOLDER = holder_of_app(namespace="default", name="teleop", uid=UID, instance="", component="driver")
NODE = "amr-07"


class DriverApp:
    """A driver that wants the CAN bus of its node."""

    def __init__(self) -> None:
        self.cache = Cache()
        component = {"name": "driver", "image": "x", "devices": [{"name": "can", "type": "can"}]}
        self.app = self.cache.update_app(app_body(components=[component])).app
        self.cache.nodes[NODE] = make_node(NODE)
        self.deploy({})
        self.cache.replica_sets["rs"] = "deployment"

    def deploy(self, annotations: dict[str, str]) -> None:
        owner = {"apiVersion": "v", "kind": "RobotApp", "name": "teleop", "uid": UID, "controller": True}
        meta: dict[str, Any] = {"name": "driver", "namespace": "default", "uid": "deployment", "labels": LABELS}
        meta |= {"annotations": annotations, "ownerReferences": [owner]}
        self.cache.deployments.put(
            UID, "driver", msgspec.convert({"metadata": meta, "spec": {"replicas": 1}}, Deployment)
        )

    def pod(self, uid: str, node: str) -> None:
        owner = {"apiVersion": "v", "kind": "ReplicaSet", "name": "rs", "uid": "rs", "controller": True}
        meta = {"name": uid, "namespace": "default", "uid": uid, "labels": LABELS, "ownerReferences": [owner]}
        body = {"metadata": meta, "spec": {"nodeName": node}, "status": {"phase": "Pending"}}
        self.cache.pods.put(UID, uid, msgspec.convert(body, Pod))

    def plug(self, *, present: bool) -> None:
        devices = [{"id": "can-can0", "type": "can", "present": present}]
        body = {"metadata": {"name": NODE, "uid": "t"}, "status": {"devices": devices}}
        self.cache.put_telemetry(msgspec.convert(body, Telemetry), now_s=0.0)

    def claim(self, **status: Any) -> str:
        claim = device_claim(holder=HOLDER, node=NODE, **status)
        self.cache.claims.put(UID, claim.name, claim)
        return claim.name

    def facts(self) -> InstanceFacts:
        assert self.app is not None
        return instance_facts(
            self.app, Instance(), self.cache, outcome=None, trouble=None, held=(), now_s=0.0, now=utc_now()
        )


@pytest.fixture
def world() -> DriverApp:
    return DriverApp()


def test_a_device_that_was_lost_stays_lost_while_its_node_is_silent(world: DriverApp) -> None:
    world.pod("old", NODE)
    claim = world.claim(pod="old")
    world.plug(present=False)
    assert [device.device for device in world.facts().lost] == ["can-can0"]
    world.deploy({Annotation.LOST_DEVICES.value: json.dumps({claim: "old"})})  # as the operator records it
    world.cache.nodes[NODE] = make_node(NODE, ready=False)
    assert [device.device for device in world.facts().lost] == ["can-can0"]


def test_what_a_silent_node_reported_last_is_no_loss(world: DriverApp) -> None:
    world.pod("old", NODE)
    world.claim(pod="old")
    world.plug(present=False)
    world.cache.nodes[NODE] = make_node(NODE, ready=False)
    assert world.facts().lost == ()


@pytest.mark.parametrize(("present", "held"), [(True, 1), (False, 0)])
def test_a_claim_that_waits_for_the_next_pod_counts_while_its_device_is_there(
    world: DriverApp, present: bool, held: int
) -> None:
    world.pod("new", "")
    world.claim(phase="Draining")
    world.plug(present=present)
    facts = world.facts()
    assert (facts.devices_held, facts.devices_wanted) == (held, 1)
