"""Pods whose devices are lost are left alone, restarted when they are back, or evicted for another device (onLoss)."""

from collections.abc import AsyncIterator

import msgspec
import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for
from tests.unit.operating.reconcile.test_mover import FOR_S, Scene, read_instance

from robotapp_api.model.names import Annotation
from robotapp_operator.plan.spec.objects import Pod, Taint
from robotapp_operator.reconcile.mover import LOST_S, MASS_LOSS_S
from robotapp_operator.watch.facts.device_facts import device_losses


@pytest.fixture
async def world() -> AsyncIterator[Scene]:
    async with FakeApiServer() as api, client_for(api.endpoint, field_manager="robotapp-operator") as client:
        yield Scene(api, client)


async def test_a_pod_whose_device_is_kept_is_left_alone_and_the_loss_is_remembered_while_it_lasts(
    world: Scene,
) -> None:
    await world.app(on_loss="Keep")
    await world.plug(present=False)
    assert await world.look() == LOST_S
    await world.look(later_s=LOST_S)
    assert list(await world.annotation(Annotation.LOST_DEVICES)) == ["dev.n.usb-cam"]
    world.devices["far"] = []
    await world.mirror()
    assert [str(one) for one in world.observer.instance(*read_instance(world)).lost] == ["device usb-cam on far"]
    await world.plug(present=True)
    await world.look()
    assert await world.annotation(Annotation.LOST_DEVICES) is None
    assert await world.pods() == ["driver", "planner"]


async def test_a_pod_is_restarted_when_its_device_is_back_also_by_another_operator_and_once(world: Scene) -> None:
    await world.app(on_loss="Restart")
    await world.plug(present=False)
    await world.look()
    await world.look(later_s=LOST_S)
    assert await world.pods() == ["driver", "planner"], "without its device it could not start"
    world.start()
    await world.mirror()
    await world.plug(present=True)
    await world.look()
    assert await world.pods() == ["driver"]
    await world.pod("planner", "far")
    await world.mirror()
    await world.plug(present=True)
    await world.look()
    await world.look()
    assert await world.pods() == ["driver", "planner"]
    assert await world.annotation(Annotation.LOST_DEVICES) is None
    assert await world.annotation(Annotation.MOVES) is None, "it went nowhere"


async def test_a_cable_that_was_touched_restarts_nothing(world: Scene) -> None:
    await world.app(on_loss="Restart")
    await world.plug(present=False)
    await world.look()
    await world.plug(present=True)
    await world.look(later_s=LOST_S)
    assert await world.annotation(Annotation.LOST_DEVICES) is None
    assert await world.pods() == ["driver", "planner"]


async def test_a_pod_moves_to_another_device_where_there_is_one_that_is_free(world: Scene) -> None:
    await world.app(on_loss="Reschedule")
    await world.plug(present=False)
    await world.look()
    await world.look(later_s=LOST_S)
    assert await world.pods() == ["driver", "planner"]
    assert world.device_stays() == "no other node has such a device that is free"
    await world.plug(present=True, node="near")
    await world.look()
    assert await world.pods() == ["driver"]
    await world.pod("planner", "near")
    await world.look()
    assert world.events == [("Rescheduled", "planner moved from far to near: device usb-cam on far is lost")]


async def test_when_all_pods_of_a_node_lose_their_devices_at_once_none_moves_until_some_are_back(world: Scene) -> None:
    await world.app(on_loss="Reschedule")
    await world.plug(present=False)
    await world.plug(present=True, node="near")
    world.also_holds(pods=3)
    await world.look()
    assert await world.look(later_s=LOST_S + FOR_S) == MASS_LOSS_S
    assert await world.pods() == ["driver", "planner"]
    assert "so many pods on its node lost devices at once" in world.device_stays()
    world.devices["far"] = [device for device in world.devices["far"] if device.id == "usb-cam"]
    await world.look(later_s=MASS_LOSS_S)
    assert await world.pods() == ["driver"]


async def test_a_recorded_loss_counts_as_one_also_when_the_agent_speaks_of_nothing_any_more(world: Scene) -> None:
    await world.app(on_loss="Keep")
    await world.plug(present=False)
    await world.look()
    await world.look(later_s=LOST_S)
    world.devices["far"] = []
    await world.mirror()
    assert device_losses(world.cache).lost.keys() == {"far"}


async def test_devices_that_many_pods_lost_at_once_restart_nothing_when_they_are_back(world: Scene) -> None:
    await world.app(on_loss="Restart")
    await world.plug(present=False)
    world.also_holds(pods=4)
    await world.look()
    assert await world.look(later_s=LOST_S + FOR_S) == MASS_LOSS_S
    assert await world.annotation(Annotation.LOST_DEVICES) is None
    await world.plug(present=True)
    await world.look()
    assert await world.pods() == ["driver", "planner"]


async def test_a_component_tied_to_its_robot_is_not_evicted_for_a_device_elsewhere(world: Scene) -> None:
    await world.app(on_loss="Reschedule", runsOn=["Robot"])
    await world.plug(present=False)
    await world.plug(present=True, node="near")
    await world.look()
    await world.look(later_s=LOST_S)
    assert await world.pods() == ["driver", "planner"]
    assert world.device_stays() == "it stays on its robot: runsOn is [Robot]"


async def test_no_pod_is_evicted_for_a_device_that_bare_pods_share(world: Scene) -> None:
    await world.app(on_loss="Reschedule")
    await world.plug(present=False)
    await world.plug(present=True, node="near")
    meta = {"name": "viewer", "namespace": "lab", "annotations": {Annotation.GRANTED_SHARED: "usb-cam"}}
    viewer = msgspec.convert({"metadata": meta, "spec": {"nodeName": "near"}}, Pod)
    world.cache.bare_pods.put("lab", "viewer", viewer)
    await world.look()
    await world.look(later_s=LOST_S)
    assert await world.pods() == ["driver", "planner"], "its successor would have to wait for them"
    world.cache.bare_pods.drop("lab", "viewer")
    await world.look()
    assert await world.pods() == ["driver"]


async def test_no_pod_is_evicted_for_a_node_whose_taints_it_does_not_tolerate(world: Scene) -> None:
    await world.app(on_loss="Reschedule")
    await world.plug(present=False)
    await world.plug(present=True, node="near")
    world.cache.nodes["near"].spec.taints = [Taint(key="lab.example/only", effect="NoSchedule")]
    await world.look()
    await world.look(later_s=LOST_S)
    assert await world.pods() == ["driver", "planner"], "its successor would find no place"
    assert world.device_stays() == "no other node has such a device that is free"
    world.cache.nodes["near"].spec.taints = [Taint(key="lab.example/soft", effect="PreferNoSchedule")]
    await world.look()
    assert await world.pods() == ["driver"]
