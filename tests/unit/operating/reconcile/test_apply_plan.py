"""Carrying out a plan: preconditions on every write, and what each refusal means."""

from typing import Any

import pytest
from tests.support.factories import VERSION, after, make_app
from tests.support.scripted import ScriptedClient

from robotapp_api.model.names import QUEUE_NAME, Reason
from robotapp_claims.rules.domain import Fence
from robotapp_client import AlreadyExists, Conflict, Forbidden, Invalid, NamespaceTerminating, NotFound
from robotapp_operator.plan.diff.diff import Change, Observed, Plan, plan, wanted_children
from robotapp_operator.plan.spec.desired import Domain, desired_of
from robotapp_operator.plan.spec.objects import ChildRef, Job, Meta
from robotapp_operator.queue.work import StartOver
from robotapp_operator.reconcile.apply_plan import Written, execute, stop

APP = make_app(ros2={"discovery": {"mode": "Peers"}})
NEWER = make_app(ros2={"discovery": {"mode": "Peers"}}, generation=2, suspend=True)


def children(running: bool = True) -> list[Any]:
    return wanted_children(desired_of(APP, ""), domain=Domain(7, "c"), parameters={}, running=running)


def fresh() -> Plan:
    return plan(APP, children(), {}, version=VERSION, settled={})


def there() -> dict[ChildRef, Observed]:
    return after(fresh(), {}, APP)


def change_of_one() -> Plan:
    changes = plan(NEWER, children(running=False), there(), version=VERSION, settled={}).changes
    return Plan(changes=tuple(change for change in changes if "driver" in change.child.ref.name))


async def run(client: ScriptedClient, what: Plan, fences: dict[str, Fence] | None = None) -> Written:
    return await execute(client, APP, what, fences=fences or {}, version=VERSION)  # type: ignore[arg-type] - a double


def answer(*_: Any) -> dict[str, Any]:
    return {"metadata": {"uid": "u", "generation": 3, "resourceVersion": "9"}}


def refusal(kind: Any, message: str, status: int) -> Exception:
    error: Exception = kind(message, status=status)
    return error


def live(resource_version: str = "1", *, manager: str = "kubectl", operation: str = "Update") -> dict[str, Any]:
    (change,) = change_of_one().changes
    assert change.over is not None
    entry = {"manager": manager, "operation": operation}
    return {
        "metadata": {
            "uid": change.over.metadata.uid,
            "resourceVersion": resource_version,
            "managedFields": [
                {"manager": "kube-controller-manager", "operation": "Update", "subresource": "status"},
                entry,
            ],
        }
    }


async def test_absent_children_are_posted() -> None:
    client = ScriptedClient().always("create", answer)
    done = await run(client, fresh())
    assert client.methods() == ["create"] * 3
    assert done.count == 3


async def test_what_was_written_is_remembered_by_generation_and_hash() -> None:
    client = ScriptedClient().always("create", answer)
    (change, *_) = fresh().changes
    done = await run(client, Plan(changes=(change,)))
    assert done.settled == {"u": (3, change.child.hash)}


async def test_existing_children_are_applied_with_uid_and_the_fenced_version() -> None:
    client = ScriptedClient().always("get", live("5")).always("apply", answer)
    what = change_of_one()
    (change,) = what.changes
    assert change.over is not None
    fence = Fence(change.over.metadata.uid, "5")
    await run(client, what, {change.child.ref.name: fence})
    _, _, body = client.calls[-1]
    assert body["metadata"]["uid"] == fence.uid
    assert body["metadata"]["resourceVersion"] == "5"


async def test_what_a_deployment_tells_of_the_past_of_its_component_survives_an_apply() -> None:
    client = ScriptedClient().always("get", live()).always("apply", answer)
    what = change_of_one()
    (change,) = what.changes
    assert change.over is not None
    past = {"robotics.io/moves": "m", "robotics.io/lost-devices": "l"}
    change.over.metadata.annotations.update(past | {"example.com/team": "t"})
    await run(client, what)
    written = client.calls[-1][2]["metadata"]["annotations"]
    assert {key: written.get(key) for key in past} == past
    assert "example.com/team" not in written


async def test_a_child_that_changed_since_it_was_read_is_not_written() -> None:
    client = ScriptedClient().always("get", live("6"))
    with pytest.raises(StartOver):
        await run(client, change_of_one())
    assert client.methods() == ["get"]


async def test_fields_created_by_post_are_made_ours_before_the_first_apply() -> None:
    client = (
        ScriptedClient()
        .always("get", live(manager="robotapp-operator"))
        .always("patch", answer)
        .always("apply", answer)
    )
    await run(client, change_of_one())
    assert client.methods() == ["get", "patch", "apply"]
    _, patch = client.calls[1][2]
    assert patch[0] == {"op": "test", "path": "/metadata/resourceVersion", "value": "1"}
    assert patch[1]["path"] == "/metadata/managedFields/1/operation"
    assert client.calls[2][2]["metadata"]["resourceVersion"] == "9"


async def test_fields_that_are_ours_by_apply_need_no_further_write() -> None:
    applied = live(manager="robotapp-operator", operation="Apply")
    client = ScriptedClient().always("get", applied).always("apply", answer)
    await run(client, change_of_one())
    assert client.methods() == ["get", "apply"]


async def test_fields_of_an_amendment_join_the_record_of_our_applies() -> None:
    """Left alone they would outlive the step or container they belong to, and renamed they would replace the record."""
    both = live(manager="robotapp-operator")
    applied = {"f:spec": {"f:replicas": {}, "f:template": {"f:spec": {}}}}
    both["metadata"]["managedFields"][1]["fieldsV1"] = {"f:spec": {"f:strategy": {}, "f:template": {"f:metadata": {}}}}
    both["metadata"]["managedFields"].append(
        {"manager": "robotapp-operator", "operation": "Apply", "fieldsV1": applied}
    )
    client = ScriptedClient().always("get", both).always("patch", answer).always("apply", answer)
    await run(client, change_of_one())
    _, patch = client.calls[1][2]
    template = {"f:spec": {}, "f:metadata": {}}
    assert patch[1:] == [
        {
            "op": "replace",
            "path": "/metadata/managedFields/2/fieldsV1",
            "value": {"f:spec": {"f:replicas": {}, "f:strategy": {}, "f:template": template}},
        },
        {"op": "remove", "path": "/metadata/managedFields/1"},
    ]


async def test_a_template_of_a_newer_operator_is_amended_by_a_patch_of_the_version_that_was_read() -> None:
    (change,) = change_of_one().changes
    assert change.over is not None
    client = ScriptedClient().always("patch", answer)
    spec = {"replicas": 0}
    fence = {change.child.ref.name: Fence(change.over.metadata.uid, "5")}
    done = await run(client, Plan(changes=(Change(change.child, change.over, spec),)), fence)
    assert client.methods() == ["patch"]
    _, patch = client.calls[0][2]
    assert patch == [
        {"op": "test", "path": "/metadata/resourceVersion", "value": "5"},
        {"op": "replace", "path": "/spec", "value": spec},
    ]
    assert done.settled == {"u": (3, change.child.hash)}


async def test_a_domain_that_apply_cannot_remove_is_taken_out_of_exactly_the_version_apply_left() -> None:
    stray = {"name": "wait-for-names", "env": [{"name": "ROS_DOMAIN_ID", "value": "99"}]}
    applied = answer() | {"spec": {"template": {"spec": {"containers": [], "initContainers": [stray]}}}}
    client = ScriptedClient().always("get", live()).always("apply", applied).always("patch", answer)
    await run(client, change_of_one())
    assert client.methods() == ["get", "apply", "patch"]
    _, patch = client.calls[-1][2]
    assert patch == [
        {"op": "test", "path": "/metadata/resourceVersion", "value": "9"},
        {"op": "remove", "path": "/spec/template/spec/initContainers/0/env/0"},
    ]


@pytest.mark.parametrize("error", [refusal(Conflict, "x", 409), refusal(NotFound, "x", 404)])
async def test_a_lost_race_starts_over(error: Exception) -> None:
    client = ScriptedClient().always("get", live()).always("apply", error)
    with pytest.raises(StartOver):
        await run(client, change_of_one())


def a_failed_test() -> Exception:
    return refusal(Invalid, "the server rejected our request due to an error in our request", 422)


@pytest.mark.parametrize("before", [[], [answer]], ids=["to make fields ours", "to take a stray out"])
async def test_a_patch_whose_test_fails_lost_a_race_and_is_no_refusal(before: list[Any]) -> None:
    """The Deployment's own controller writes between our read and our patch."""
    stray = {"name": "c", "env": [{"name": "ROS_DOMAIN_ID", "value": "99"}]}
    applied = answer() | {"spec": {"template": {"spec": {"containers": [stray]}}}}
    client = ScriptedClient().always("get", live(manager="robotapp-operator")).always("apply", applied)
    with pytest.raises(StartOver):
        await run(client.script("patch", *before, a_failed_test()), change_of_one())


async def test_a_patch_that_names_a_wrong_field_is_a_refusal() -> None:
    error = Invalid("no", status=422, causes=(("spec", "FieldValueInvalid", "no"),))
    done = await run(
        ScriptedClient().always("get", live(manager="robotapp-operator")).always("patch", error), change_of_one()
    )
    assert [reason for reason, _ in done.refusals] == [Reason.FAILED_CREATE]


async def test_refusals_are_collected_and_the_other_children_still_written() -> None:
    quota = refusal(Forbidden, "exceeded quota: small", 403)
    client = ScriptedClient().script("create", quota, refusal(Forbidden, "denied", 403)).always("create", answer)
    done = await run(client, fresh())
    assert [reason for reason, _ in done.refusals] == [Reason.QUOTA_REFUSED, Reason.FAILED_CREATE]
    assert done.count == 1
    assert "exceeded quota" in done.refusals[0][1]


async def test_nothing_more_is_tried_where_the_namespace_is_being_deleted() -> None:
    client = ScriptedClient().always("create", refusal(NamespaceTerminating, "being terminated", 403))
    with pytest.raises(NamespaceTerminating):
        await run(client, fresh())
    assert client.methods() == ["create"]


def taken_by(**owner: Any) -> ScriptedClient:
    meta: dict[str, Any] = {"name": "x", "uid": "other", "resourceVersion": "4"}
    if owner:
        meta["ownerReferences"] = [{"controller": True, **owner}]
    busy = refusal(AlreadyExists, "exists", 409)
    return ScriptedClient().script("create", busy).always("get", {"metadata": meta}).always("patch", answer)


def one() -> Plan:
    return Plan(changes=(Change(fresh().changes[0].child, None),))


async def test_a_taken_name_is_a_refusal_not_a_take_over() -> None:
    client = taken_by()
    done = await run(client, one())
    assert done.refusals[0][0] == Reason.FAILED_CREATE
    assert "belongs to somebody else" in done.refusals[0][1]
    assert client.methods() == ["create", "get"]


async def test_the_predecessors_child_is_waited_for() -> None:
    with pytest.raises(StartOver, match="still there"):
        await run(taken_by(kind="RobotApp", name=APP.name, uid="before"), one())


async def test_our_own_child_without_labels_gets_them_back() -> None:
    client = taken_by(kind="RobotApp", name=APP.name, uid=APP.uid)
    with pytest.raises(StartOver, match="lost its labels"):
        await run(client, one())
    assert client.calls[-1][2][1]["metadata"]["resourceVersion"] == "4"


async def test_deletes_name_the_uid_and_do_not_mind_being_late() -> None:
    client = ScriptedClient().always("delete", refusal(NotFound, "gone", 404))
    what = plan(APP, [], there(), version=VERSION, settled={})
    done = await run(client, what)
    assert done.count == 3
    assert all(method == "delete" and body["uid"] for method, _, body in client.calls)


@pytest.mark.parametrize(("labels", "method"), [({}, "patch"), ({QUEUE_NAME: "nightly"}, "delete")])
async def test_a_job_is_stopped_by_suspension_and_in_a_queue_by_deletion(labels: dict[str, str], method: str) -> None:
    """kueue would resume a Job that somebody else has suspended."""
    client = ScriptedClient().always(method, answer)
    job = Job(metadata=Meta(name="save", namespace="default", uid="u", resource_version="1", labels=labels))
    await stop(client, job)  # type: ignore[arg-type] - a double
    assert client.methods() == [method]
