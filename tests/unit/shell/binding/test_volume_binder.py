"""From a volume decision to bound claims, with every way in which that can go wrong."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from tests.support.scheduler.volumes import make_claim, make_volume, mounting
from tests.support.scheduling import make_node
from tests.support.scripted import ScriptedClient

from robotapp_client.transport.errors import Conflict
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan
from robotapp_scheduler.shell.binding.volume_binder import VolumeWriter, claim_patch, volume_patch

MAP = ("default", "map")
BINDING = VolumePlan("n0", bindings=((MAP, "v"),), provisions=(), timeout_s=5.0)
PROVISION = VolumePlan("n0", bindings=(), provisions=(MAP,), timeout_s=5.0)
REF = {"namespace": "default", "name": "map", "uid": "claim-map"}


class Rig:
    """A writer over a real cluster; `then` happens while it waits."""

    def __init__(self) -> None:
        self.client = ScriptedClient()
        self.cluster = Cache(clock=self.clock)
        self.cluster.apply_node(make_node("n0"))
        self.store = self.cluster.volumes
        self.alive = True
        self.now_s = 0.0
        self.writer = VolumeWriter(
            self.client,
            self.cluster,
            alive=lambda _: self.alive,
            clock=self.clock,
        )

    def clock(self) -> float:
        return self.now_s

    async def bind(self, plan: VolumePlan, *then: Callable[[], Any]) -> str:
        task = asyncio.create_task(self.writer.bind(mounting("map"), plan))
        for step in then:
            for _ in range(5):
                await asyncio.sleep(0)
            assert not task.done()
            step()
            self.writer.notify()
        return await asyncio.wait_for(task, 60)


def written(version: str) -> dict[str, Any]:
    return {"metadata": {"resourceVersion": version}}


def newer(thing: Any, version: str) -> Any:
    thing.metadata.resource_version = version
    return thing


async def test_a_volume_is_given_to_the_claim_and_the_pod_waits_until_the_claim_is_bound() -> None:
    rig = Rig()
    rig.client.script("patch", written("8"))
    rig.store.apply_volume(make_volume("v"))
    rig.store.apply_claim(make_claim("map"))
    trouble = await rig.bind(
        BINDING,
        lambda: rig.store.apply_volume(newer(make_volume("v", claim=REF), "8")),
        lambda: rig.store.apply_claim(make_claim("map", volume="v")),
    )
    assert trouble == ""
    ((method, path, (_, body)),) = rig.client.calls
    assert (method, path) == ("patch", "/api/v1/persistentvolumes/v")
    assert body == {
        "metadata": {
            "uid": "volume-v",
            "resourceVersion": "7",
            "annotations": {"pv.kubernetes.io/bound-by-controller": "yes"},
        },
        "spec": {
            "claimRef": {
                "apiVersion": "v1",
                "kind": "PersistentVolumeClaim",
                "namespace": "default",
                "name": "map",
                "uid": "claim-map",
                "resourceVersion": "5",
            }
        },
    }
    assert repr(rig.writer) == "<VolumeWriter, 0 pods wait for volumes>"


async def test_a_claim_is_tied_to_the_node_and_its_provisioner_does_the_rest() -> None:
    rig = Rig()
    rig.client.script("patch", written("6"))
    rig.store.apply_claim(make_claim("map"))
    trouble = await rig.bind(
        PROVISION,
        lambda: rig.store.apply_claim(newer(make_claim("map", selected="n0"), "6")),
        lambda: rig.store.apply_claim(newer(make_claim("map", selected="n0", volume="made"), "9")),
        lambda: rig.store.apply_volume(make_volume("made", on=["n0"])),
    )
    assert trouble == ""
    ((_, path, (_, body)),) = rig.client.calls
    assert path == "/api/v1/namespaces/default/persistentvolumeclaims/map"
    assert body["metadata"]["annotations"] == {"volume.kubernetes.io/selected-node": "n0"}
    assert body["metadata"]["resourceVersion"] == "5"


async def test_what_an_earlier_attempt_has_written_is_not_written_again() -> None:
    assert volume_patch(make_volume("v", claim=REF), make_claim("map")) is None
    assert claim_patch(make_claim("map", selected="n0"), "n0") is None
    rig = Rig()
    rig.store.apply_volume(make_volume("v", claim=REF))
    rig.store.apply_claim(make_claim("map", volume="v"))
    assert await rig.bind(BINDING) == ""
    assert rig.client.calls == []


def test_a_volume_that_a_user_set_aside_is_not_marked_as_bound_by_a_controller() -> None:
    patch = volume_patch(make_volume("v", claim={"namespace": "default", "name": "map"}), make_claim("map"))
    assert patch is not None
    assert "annotations" not in patch["metadata"]


@pytest.mark.parametrize(
    ("plan", "step", "text"),
    [
        (
            PROVISION,
            lambda store: store.apply_claim(newer(make_claim("map"), "9")),
            'binding volumes: provisioning failed for PVC "map"',
        ),
        (
            PROVISION,
            lambda store: store.remove_claim(make_claim("map")),
            'binding volumes: failed to check binding: could not find v1.PersistentVolumeClaim "default/map"',
        ),
        (
            BINDING,
            lambda store: store.apply_volume(newer(make_volume("v"), "9")),
            'binding volumes: ClaimRef got reset for pv "v"',
        ),
        (
            BINDING,
            lambda store: store.remove_volume(make_volume("v")),
            'binding volumes: failed to check binding: could not find v1.PersistentVolume "v"',
        ),
        (
            BINDING,
            lambda store: store.apply_volume(newer(make_volume("v", on=["n1"], claim=REF), "9")),
            'binding volumes: pv "v" node affinity doesn\'t match node "n0": no matching NodeSelectorTerms',
        ),
    ],
)
async def test_claims_that_will_not_be_bound_send_the_pod_back(
    plan: VolumePlan, step: Callable[[Any], Any], text: str
) -> None:
    rig = Rig()
    rig.client.script("patch", written("8"))
    rig.store.apply_volume(make_volume("v"))
    rig.store.apply_claim(make_claim("map"))
    assert await rig.bind(plan, lambda: step(rig.store)) == text


async def test_a_write_that_is_refused_a_vanished_object_and_a_vanished_node_are_reasons_not_exceptions() -> None:
    rig = Rig()
    assert "gone" in await rig.bind(PROVISION)
    assert "gone" in await rig.bind(BINDING)
    rig.store.apply_claim(make_claim("map"))
    rig.client.script("patch", Conflict("the object has been modified", status=409))
    assert "the object has been modified" in await rig.bind(PROVISION)
    rig.client.script("patch", written("8"))
    rig.store.apply_volume(make_volume("v"))

    def vanish() -> None:
        rig.cluster.remove_node("n0")
        rig.store.apply_volume(newer(make_volume("v", claim=REF, on=["n0"]), "8"))

    assert 'failed to get node "n0"' in await rig.bind(BINDING, vanish)


async def test_a_pod_that_is_gone_and_a_provisioner_that_never_answers_end_the_wait() -> None:
    rig = Rig()
    rig.client.always("patch", written("8"))
    rig.store.apply_claim(make_claim("map"))

    def delete() -> None:
        rig.alive = False

    assert "pod does not exist any more" in await rig.bind(PROVISION, delete)
    rig.alive = True

    def late() -> None:
        rig.now_s += 6.0

    assert await rig.bind(PROVISION, late) == "binding volumes: context deadline exceeded"
