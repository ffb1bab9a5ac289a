"""Which pods have their events read, how often, and what is shown of them."""

from collections.abc import AsyncIterator
from typing import Any

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.support.factories import UID, app_body, make_pod

from robotapp_api.model.names import API_VERSION, Label, Reason
from robotapp_claims.rules.objects import ResourceClaim
from robotapp_client import ApiClient
from robotapp_client.api.resources import EVENTS
from robotapp_operator.plan.spec.objects import Deployment, Pod
from robotapp_operator.plan.status.components import HelperPart, component_view
from robotapp_operator.plan.status.pods.pod_warnings import PodWarning, awaits_containers, explain_warnings
from robotapp_operator.queue.work import Work, namespace_group
from robotapp_operator.queue.workqueue import Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.pod_events import AT_ONCE, GIVE_BACK_S, LATER_S, NEW_S, REFUSED_S, SOON_S, PodEvents

GROUP = namespace_group("default")
MOUNT = 'MountVolume.SetUp failed for volume "v" : secret "tokens" not found'
CREATING = ("ContainerCreating", "")
IN_USE_NOTE = "device serial-1 of node n is in use by claim x; the pod starts when it is free"


class WatchedEvents:
    def __init__(self, api: FakeApiServer, client: ApiClient) -> None:
        self.api = api
        self.client = client
        self.now_s = 0.0
        self.cache = Cache()
        self.cache.update_app(app_body())
        self.queue = Queue(clock=lambda: self.now_s, jitter=lambda: 0.0)
        self.events = PodEvents(client, self.cache, self.queue, clock=lambda: self.now_s)

    def wait(self, name: str) -> Pod:
        labels = {Label.APP_UID.value: UID, Label.INSTANCE.value: ""}
        pod = make_pod(name, node="n", waiting=CREATING, metadata={"labels": labels})
        self.cache.note_waiting(pod, waits=True)
        return pod

    async def event(
        self, name: str, uid: str, note: str, *, reason: str = "FailedMount", at: str = "2026-01-01T00:00:00Z"
    ) -> None:
        body = {
            "metadata": {"name": name, "namespace": "default"},
            "regarding": {"uid": uid},
            "type": "Warning",
            "reason": reason,
            "note": note,
            "deprecatedLastTimestamp": at,
        }
        await self.client.create(EVENTS, body)


@pytest.fixture
async def world() -> AsyncIterator[WatchedEvents]:
    async with FakeApiServer() as api, client_for(api.endpoint) as client:
        yield WatchedEvents(api, client)


async def test_a_missing_secret_is_taken_from_the_events_of_the_pod_and_wakes_its_app(world: WatchedEvents) -> None:
    pod = world.wait("p")
    await world.event("one", pod.metadata.uid, MOUNT)
    await world.event("other", "somebody-else", "MountVolume.SetUp failed: no such host")
    assert await world.events.look(GROUP) == SOON_S
    assert world.cache.pod_failures == {pod.metadata.uid: f"FailedMount: {MOUNT}; create it, or write optional: true"}
    world.now_s += 10
    woken = set()
    while item := world.queue.pop():
        woken.add(item[0].work)
        world.queue.done(item[0])
    assert woken == {Work.STATUS, Work.INSTANCE}


async def test_a_few_pods_are_read_at_a_time_those_first_that_were_not_read_yet(world: WatchedEvents) -> None:
    for number in range(AT_ONCE + 2):
        world.wait(f"p{number}")
    await world.events.look(GROUP)
    assert len(reads(world)) == AT_ONCE
    await world.events.look(GROUP)
    assert len(set(reads(world))) == AT_ONCE + 2


def reads(world: WatchedEvents) -> list[str]:
    return [path for method, path in world.api.requests if method == "GET" and "/events" in path]


async def test_a_pod_that_waits_for_long_is_looked_at_less_often(world: WatchedEvents) -> None:
    world.wait("p")
    assert await world.events.look(GROUP) == SOON_S
    world.now_s += NEW_S
    assert await world.events.look(GROUP) == LATER_S


async def test_a_pod_that_waits_no_more_has_no_failure_and_costs_nothing(world: WatchedEvents) -> None:
    pod = world.wait("p")
    await world.event("one", pod.metadata.uid, MOUNT)
    await world.events.look(GROUP)
    world.cache.note_waiting(pod, waits=False)
    assert world.cache.pod_failures == {}
    world.api.requests.clear()
    assert await world.events.look(GROUP) is None
    assert world.api.requests == []
    assert repr(world.events) == "<PodEvents: 0 pods>"


async def test_rights_of_an_older_chart_end_no_work(world: WatchedEvents) -> None:
    world.wait("p")
    world.api.forbidden.add(EVENTS.path("default"))
    assert await world.events.look(GROUP) == REFUSED_S
    assert world.cache.pod_failures == {}


def with_status(pod: Pod, **status: Any) -> Pod:
    body = msgspec.to_builtins(pod)
    body["status"] = {**body["status"], **status}
    return msgspec.convert(body, Pod)


def test_a_pod_awaits_its_containers_until_its_volumes_are_there_or_its_image_comes() -> None:
    creating = make_pod("p", node="n", waiting=CREATING)
    assert awaits_containers(creating)
    assert not awaits_containers(make_pod("p", node="n"))
    assert awaits_containers(make_pod("p", node="n", waiting=("ImagePullBackOff", "")))
    assert not awaits_containers(make_pod("p", waiting=CREATING))
    assert not awaits_containers(make_pod("p", node="n", waiting=("CrashLoopBackOff", "")))
    assert not awaits_containers(
        make_pod("p", node="n", waiting=CREATING, metadata={"deletionTimestamp": "2026-01-01T00:00:00Z"})
    )
    mounted = [{"type": "PodReadyToStartContainers", "status": "True"}]
    assert not awaits_containers(with_status(creating, conditions=mounted))
    assert not awaits_containers(with_status(creating, phase="Failed"))


def test_what_is_absent_is_told_before_a_timeout_and_other_events_not_at_all() -> None:
    timeout = PodWarning("FailedMount", "Unable to attach or mount volumes: timed out waiting for the condition")
    absent = PodWarning("FailedMount", MOUNT)
    assert explain_warnings([timeout, absent]) == f"FailedMount: {MOUNT}; create it, or write optional: true"
    assert explain_warnings([timeout]).startswith("FailedMount: Unable to attach")
    assert explain_warnings([PodWarning("Unhealthy", "probe failed")]) == ""
    assert len(explain_warnings([PodWarning("FailedMount", "x" * 10_000)])) < 600


def deployment() -> Deployment:
    return msgspec.convert({"metadata": {"name": "d", "generation": 1}, "spec": {"replicas": 1}}, Deployment)


def test_a_failed_mount_is_the_components_message_and_a_missing_pull_secret_stands_beside_the_pull() -> None:
    part = HelperPart("driver", "")
    creating = make_pod("p", node="n", waiting=CREATING)
    view = component_view(part, deployment(), [creating], failures={creating.metadata.uid: "FailedMount: x"})
    assert (view.reason, view.message) == (Reason.FAILED_CREATE, "FailedMount: x")
    pulling = make_pod("p", node="n", waiting=("ImagePullBackOff", "back-off"))
    view = component_view(
        part, deployment(), [pulling], failures={pulling.metadata.uid: "Unable to retrieve some image pull secrets (x)"}
    )
    assert view.reason is Reason.IMAGE_PULL
    assert view.message.endswith("check image and imagePullSecrets; Unable to retrieve some image pull secrets (x)")


def test_a_missing_object_of_the_environment_is_told_with_its_cure() -> None:
    pod = make_pod("p", node="n", waiting=("CreateContainerConfigError", 'secret "tokens" not found'))
    view = component_view(HelperPart("driver", ""), deployment(), [pod])
    assert view.message == 'CreateContainerConfigError: secret "tokens" not found; create it, or write optional: true'


@pytest.mark.parametrize(
    ("note", "given_back"),
    [
        (IN_USE_NOTE, True),
        ("DRA driver devices.robotics.io is not registered", False),
    ],
)
async def test_a_device_that_the_driver_refuses_for_long_is_given_back_and_one_of_a_driver_that_is_away_is_kept(
    world: WatchedEvents, note: str, given_back: bool
) -> None:
    refused: list[str] = []

    async def take(pod: Pod) -> None:
        refused.append(pod.metadata.name)

    events = PodEvents(world.client, world.cache, world.queue, clock=lambda: world.now_s, on_refused=take)
    pod = world.wait("driver")
    await world.event("e", pod.metadata.uid, note, reason="FailedPrepareDynamicResources")
    await events.look(GROUP)
    world.now_s = GIVE_BACK_S - 1
    await events.look(GROUP)
    assert refused == []
    world.now_s = GIVE_BACK_S
    await events.look(GROUP)
    assert refused == (["driver"] if given_back else [])


async def test_a_device_is_given_back_after_30_s_of_refusals_and_not_of_waiting(world: WatchedEvents) -> None:
    refused: list[str] = []

    async def take(pod: Pod) -> None:
        refused.append(pod.metadata.name)

    events = PodEvents(world.client, world.cache, world.queue, clock=lambda: world.now_s, on_refused=take)
    pod = world.wait("driver")
    await events.look(GROUP)
    world.now_s = 100.0
    await world.event("e", pod.metadata.uid, IN_USE_NOTE, reason="FailedPrepareDynamicResources")
    await events.look(GROUP)
    assert refused == [], "the driver came late, and its first answer is no refusal for 30 s"
    world.now_s += GIVE_BACK_S
    await events.look(GROUP)
    assert refused == ["driver"]


async def test_a_pod_that_got_its_device_and_waits_for_its_image_keeps_it(world: WatchedEvents) -> None:
    refused: list[str] = []

    async def take(pod: Pod) -> None:
        refused.append(pod.metadata.name)

    events = PodEvents(world.client, world.cache, world.queue, clock=lambda: world.now_s, on_refused=take)
    pod = world.wait("driver")
    await world.event("e", pod.metadata.uid, IN_USE_NOTE, reason="FailedPrepareDynamicResources")
    await events.look(GROUP)
    labels = {"labels": pod.metadata.labels}
    pulling = make_pod("driver", node="n", waiting=("ImagePullBackOff", "no such host"), metadata=labels)
    world.cache.note_waiting(pulling, waits=awaits_containers(pulling))
    world.now_s = 2 * GIVE_BACK_S
    await events.look(GROUP)
    assert world.cache.is_waiting(pod.metadata.uid)
    assert refused == []


@pytest.mark.parametrize(("user", "is_replaced"), [("another-pod", True), ("", True), ("own", False)])
async def test_a_pod_whose_claim_was_deleted_below_it_is_replaced_when_the_claim_is_there_anew(
    world: WatchedEvents, user: str, *, is_replaced: bool
) -> None:
    refused: list[str] = []

    async def take(pod: Pod) -> None:
        refused.append(pod.metadata.name)

    events = PodEvents(world.client, world.cache, world.queue, clock=lambda: world.now_s, on_refused=take)
    pod = world.wait("driver")
    note = f"pod driver is not allowed to use resource claim {pod.metadata.name}"
    await world.event("e", pod.metadata.uid, note, reason="FailedPrepareDynamicResources")
    await events.look(GROUP)
    world.now_s = GIVE_BACK_S
    await events.look(GROUP)
    assert refused == [], "no claim to which its successor could be bound"
    owner = {"apiVersion": API_VERSION, "kind": "RobotApp", "name": "teleop", "uid": UID, "controller": True}
    uid = pod.metadata.uid if user == "own" else user
    claim = {
        "metadata": {
            "name": "c",
            "namespace": "default",
            "labels": {Label.APP_UID.value: UID, Label.INSTANCE.value: ""},
            "ownerReferences": [owner],
        },
        "status": {"reservedFor": [{"resource": "pods", "name": "p", "uid": uid}] if uid else []},
    }
    world.cache.allocations.put_claim(msgspec.convert(claim, ResourceClaim), before=None)
    for _ in range(2):
        await events.look(GROUP)
        world.now_s += GIVE_BACK_S
    assert refused == (["driver"] if is_replaced else [])
