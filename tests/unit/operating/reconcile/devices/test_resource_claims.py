"""Which ResourceClaims are created and deleted: none below a pod that uses it, and every other one that nobody wants."""

from typing import Any

import msgspec
import pytest
from tests.support.factories import component, make_app

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.objects import ResourceClaim
from robotapp_operator.plan.diff.diff import wanted_children
from robotapp_operator.plan.render.devices.resource_claim import DeviceClaim, wanted_claims
from robotapp_operator.plan.spec.desired import Domain, desired_of
from robotapp_operator.plan.spec.objects import Deployment, Pod
from robotapp_operator.reconcile.devices.resource_claims import plan_claims

APP = make_app(component("driver", devices=[{"name": "lidar", "type": "serial"}]))
CHILDREN = wanted_children(
    desired_of(APP, ""), domain=Domain(7), parameters={}, running=True, claiming=frozenset({"driver"})
)
(WANTED,) = wanted_claims(APP, CHILDREN)


def stored(wish: DeviceClaim = WANTED, **metadata: Any) -> ResourceClaim:
    body = wish.body(APP)
    body["metadata"] |= {"uid": "c-1", "namespace": APP.namespace} | metadata
    return msgspec.convert(body, ResourceClaim)


def pod(phase: str = "Running") -> Pod:
    labels = {Label.APP_UID: APP.uid, Label.COMPONENT: "driver"}
    return msgspec.convert({"metadata": {"name": "p", "uid": "p", "labels": labels}, "status": {"phase": phase}}, Pod)


def deployment(replicas: int) -> Deployment:
    (child,) = (child for child in CHILDREN if child.component == "driver")
    body = child.body(APP, version="1.0")
    body["spec"] = {**body["spec"], "replicas": replicas}
    return msgspec.convert(body, Deployment)


def names(app_claims: Any) -> tuple[list[str], list[str]]:
    creates = [claim.name for claim in app_claims.creates]
    return creates, [claim.metadata.name for claim in app_claims.deletes]


def test_a_missing_claim_is_created_and_one_that_is_there_is_left_alone() -> None:
    assert names(plan_claims(APP, [WANTED], [], deployments=[], pods=[])) == ([WANTED.name], [])
    assert names(plan_claims(APP, [WANTED], [stored()], deployments=[], pods=[pod()])) == ([], [])


def test_another_wish_replaces_the_claim_at_once() -> None:
    former = stored(annotations={Annotation.CONTENT_HASH.value: "another"})
    found = plan_claims(APP, [WANTED], [former], deployments=[deployment(1)], pods=[pod()])
    assert names(found) == ([WANTED.name], [WANTED.name])


@pytest.mark.parametrize(
    ("deployments", "pods", "is_deleted"),
    [
        ([], [], True),
        ([deployment(0)], [], True),
        ([deployment(1)], [], False),
        ([deployment(0)], [pod()], False),
        ([], [pod("Succeeded")], True),
    ],
)
def test_a_claim_that_is_not_wanted_goes_when_no_pod_uses_it_or_may_come(
    deployments: list[Deployment], pods: list[Pod], is_deleted: bool
) -> None:
    found = plan_claims(APP, [], [stored()], deployments=deployments, pods=pods)
    assert names(found) == ([], [WANTED.name] if is_deleted else [])


def test_claims_of_others_are_never_deleted() -> None:
    owner = {"apiVersion": "robotics.io/v1alpha1", "kind": "RobotApp", "name": "x", "uid": "other", "controller": True}
    others = [stored(ownerReferences=[owner]), stored(ownerReferences=[]), stored(namespace="elsewhere")]
    assert names(plan_claims(APP, [], others, deployments=[], pods=[])) == ([], [])
