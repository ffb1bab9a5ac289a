"""The claim of a device that a pod shares is held for the moment of the binding, not while the pod waits for its volumes."""

from typing import Any

import pytest
from tests.support.scheduler.devices import allocated_on, claim
from tests.support.scheduler.placing import BINDING, Rig

from robotapp_claims.rules.identity import holder_of_pod
from robotapp_claims.rules.objects import Claim, ClaimSpec, Meta
from robotapp_scheduler.core.api.core_v1 import ClaimReference
from robotapp_scheduler.core.framework.handle import BindOutcome, BindResult, Readiness, Reserved
from robotapp_scheduler.core.framework.interface import Code, Status


def sharing(version: str) -> Reserved:
    """A pod that holds the claim of a device which it shares, until it is bound."""
    claim = Claim(
        metadata=Meta(name="dev-can0"), spec=ClaimSpec(holder=holder_of_pod(namespace="a", name="p", uid="uid-p"))
    )
    return Reserved(
        Readiness.READY,
        annotations={"granted": "can0"},
        resource_version=version,
        sharing=(claim,),
    )


async def test_others_may_share_the_devices_of_a_pod_that_waits_for_its_volumes() -> None:
    rig = Rig()
    rig.with_volumes("p")
    rig.volumes.ready.clear()
    rig.io.reservations.extend((sharing("7"), sharing("8")))
    rig.show(wishes=True)
    await rig.turn()
    assert (rig.volumes.asked, rig.io.sharing) == (["p"], ["given back"])
    rig.volumes.ready.set()
    await rig.turn()
    assert [version for *_, version in rig.io.asked] == ["8"]
    assert rig.io.sharing == ["given back", "bound"]


async def test_a_pod_whose_volumes_never_come_gives_the_devices_back_once() -> None:
    rig = Rig()
    rig.with_volumes("p")
    rig.volumes.trouble = "binding volumes: context deadline exceeded"
    rig.io.reservations.append(sharing("7"))
    rig.show(wishes=True)
    await rig.turn()
    assert (rig.io.asked, rig.io.sharing) == ([], ["given back"])


async def test_a_device_that_was_taken_while_volumes_came_sends_the_pod_to_another_node_with_volumes_of_its_own() -> (
    None
):
    rig = Rig()
    rig.with_volumes("p")
    rig.io.reservations.extend((sharing("7"), Reserved(Readiness.BUSY), sharing("8"), sharing("9")))
    rig.show(wishes=True)
    await rig.turn()
    assert rig.volumes.asked == ["p", "p"]
    ((_, node, _, version),) = rig.io.asked
    assert (node, version) == (rig.core.cluster.placed["uid-p"].node, "9")
    assert rig.io.sharing == ["given back", "given back", "bound"]


async def test_a_pod_that_loses_its_device_behind_every_wait_for_volumes_is_tried_again_later() -> None:
    rig = Rig(nodes=4)
    rig.with_volumes("p")
    busy = Reserved(Readiness.BUSY)
    rig.io.reservations.extend((sharing("7"), busy, sharing("8"), busy, sharing("9")))
    rig.show(wishes=True)
    await rig.turn()
    assert (rig.io.asked, rig.io.sharing) == ([], ["given back"] * 3)
    assert rig.core.cluster.placed == {}
    assert rig.core.queue.pending()["backoff"] == 1


@pytest.mark.parametrize("answer", [BindOutcome(BindResult.FAILED, "boom"), RuntimeError("bug")])
async def test_once_a_binding_may_have_left_nothing_is_given_back(answer: Any) -> None:
    """A lost reply may mean that the pod is bound with the device."""
    rig = Rig()
    rig.io.reservations.append(sharing("7"))
    rig.io.binds.append(answer)
    rig.show(wishes=True)
    await rig.turn()
    assert (len(rig.io.asked), rig.io.sharing, rig.core.cluster.placed) == (1, [], {})


async def test_an_attempt_that_met_a_bug_leaves_what_it_holds_to_the_next_one() -> None:
    async def bug(_pod: Any, _plan: Any) -> str:
        raise RuntimeError("bug")

    rig = Rig()
    rig.claims.bind = bug  # type: ignore[method-assign]
    rig.core.cluster.resource_claims.apply_claim(claim("gpu", allocated_on(), namespace="a"))
    rig.io.reservations.append(sharing("7"))
    rig.show(wishes=True, resource_claims=(ClaimReference(name="gpu", resource_claim_name="gpu"),))
    await rig.turn()
    assert (rig.io.asked, rig.io.sharing, rig.core.cluster.placed) == ([], [], {})
    assert rig.core.queue.pending()["backoff"] == 1


async def test_a_pod_that_another_plugin_refuses_lets_others_share_its_devices() -> None:
    class Refuses:
        name = "Refuses"

        def permit(self, _pod: Any, _node: str, _ctx: Any) -> Status:
            return Status(Code.UNSCHEDULABLE, "no dock")

    rig = Rig(plugins={"Refuses": Refuses, **BINDING})
    rig.io.reservations.append(sharing("7"))
    rig.show(wishes=True)
    await rig.turn()
    assert (rig.io.asked, rig.io.sharing) == ([], ["given back"])


async def test_a_bug_after_the_bind_leaves_the_pod_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig()

    async def bug(_reserved: Reserved) -> None:
        raise RuntimeError("bug")

    monkeypatch.setattr(rig.io, "bound", bug)
    rig.io.reservations.append(sharing("7"))
    rig.show(wishes=True)
    await rig.turn()
    assert [line[0] for line in rig.said.lines] == ["scheduled"]
    assert (set(rig.core.cluster.placed), len(rig.core.queue)) == ({"uid-p"}, 0)
