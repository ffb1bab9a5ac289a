"""What wakes pods that wait for devices: a device that may be free now. What only takes one, or concerns others, does not."""

import json
from typing import Any

from tests.support.scheduling import device_claim, make_info, make_pod

from robotapp_api.model.names import Annotation, Label
from robotapp_claims.rules.identity import domain_spec
from robotapp_claims.rules.objects import Claim, Meta
from robotapp_scheduler.core.api.core_v1 import Metadata
from robotapp_scheduler.core.api.robotics_v1alpha1 import RobotApp
from robotapp_scheduler.core.api.ros import DeviceRequest, RosContext
from robotapp_scheduler.core.cycle.diagnosis import BIND_CHECK, FULL_POOL, HINTS
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.registered_plugin import RegisteredPlugin
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.ros.hardware_affinity import HardwareAffinityFilter
from robotapp_scheduler.plugins.ros.reserve import ROSReserve

RESERVE = RegisteredPlugin(ROSReserve()).queueing_hint
CAN = json.dumps({"hardware_requirements": [{"type": "can"}]})


def claim(**fields: Any) -> Claim:
    return device_claim("n", "can-can0", **{"uid": "app", "component": "driver", "pod": "old", **fields})


def domain(number: int, *, uid: str = "app") -> Claim:
    holder = claim(uid=uid).holder
    spec = domain_spec(pool="default", scope="Cluster", scope_value="", domain_id=number, holder=holder)
    return Claim(metadata=Meta(name=f"dds.default.c.{number}"), spec=spec)


def changed(old: Claim | None, new: Claim | None) -> Event:
    return Event("robotclaims", Change.CLAIMS, old, new)


def gone(**pod: Any) -> Event:
    return Event("pods", Change.POD_REMOVED, make_pod("other", **pod))


def bare() -> PodInfo:
    info = make_info("bare")
    info.ros = RosContext(devices=(DeviceRequest("can0", "can"),))
    return info


def member(component: str = "driver", *, exclusive: bool = True) -> PodInfo:
    labels = {Label.APP_UID: "app", Label.INSTANCE: "", Label.COMPONENT: component}
    info = make_info("part", labels={str(key): value for key, value in labels.items()})
    info.ros = RosContext(devices=(DeviceRequest("can0", "can", exclusive=exclusive),))
    return info


def test_a_device_that_is_given_back_wakes_and_one_that_is_taken_does_not() -> None:
    assert RESERVE.wants(bare(), changed(claim(), None))
    assert not RESERVE.wants(bare(), changed(None, claim()))
    assert not RESERVE.wants(bare(), changed(claim(), claim(pod="new")))
    assert not RESERVE.wants(bare(), changed(domain(7), None))


def test_a_device_that_waits_for_its_next_pod_wakes_the_pods_of_that_component_alone() -> None:
    assert RESERVE.of_each is not None
    for resting in (claim(phase="Draining"), claim(pod="")):
        event = changed(claim(), resting)
        assert RESERVE.of_each(event)
        assert [RESERVE.wants(pod, event) for pod in (bare(), member(), member("camera"))] == [False, True, False]
    again = changed(claim(phase="Draining"), claim())
    assert not RESERVE.of_each(again)
    assert not RESERVE.wants(member(), again)


def test_of_other_pods_that_go_only_those_matter_that_may_have_had_devices() -> None:
    assert not RESERVE.wants(bare(), gone())
    assert not RESERVE.wants(bare(), gone(annotations={str(Annotation.DDS_DOMAIN): "auto"}))
    for annotations in (Annotation.AFFINITY, Annotation.GRANTED_DEVICES, Annotation.GRANTED_SHARED):
        assert RESERVE.wants(bare(), gone(annotations={str(annotations): CAN}))
    assert RESERVE.wants(bare(), gone(labels={str(Label.APP_UID): "app"}))


def test_one_device_serves_one_pod_that_wants_it_alone_and_any_number_that_share_it() -> None:
    back = changed(claim(), None)
    assert RESERVE.most(bare(), back) == RESERVE.most(member(), back) == 1
    assert RESERVE.most(member(exclusive=False), back) is None
    changed_since = member()
    changed_since.ros = None
    assert RESERVE.most(changed_since, back) is None
    assert RESERVE.most(bare(), Event("nodes", Change.LABELS, make_pod("n"), make_pod("n"))) is None


def test_pods_that_want_other_devices_do_not_share_a_turn() -> None:
    camera = bare()
    camera.ros = RosContext(devices=(DeviceRequest("video0", "video"),))
    assert RESERVE.key(bare()) == RESERVE.key(bare())
    assert RESERVE.key(bare()) != RESERVE.key(camera)


def test_of_those_who_wait_for_a_domain_pods_that_want_devices_as_well_have_a_turn_of_their_own() -> None:
    queueing_hint = HINTS[FULL_POOL]
    wishes = [json.dumps({"hardware_requirements": [{"type": kind}]}) for kind in ("can", "can", "serial")]
    can, too, serial = (
        make_info(f"p{i}", annotations={str(Annotation.AFFINITY): text}) for i, text in enumerate(wishes)
    )
    assert queueing_hint.key(can) == queueing_hint.key(too)
    assert len({queueing_hint.key(pod) for pod in (can, serial, make_info("plain"), make_info("other"))}) == 3
    assert queueing_hint.key(make_info("broken", annotations={str(Annotation.AFFINITY): "{"})) == queueing_hint.key(
        make_info("plain")
    )
    assert queueing_hint.most(can, changed(domain(7), None)) == 1


def test_an_app_that_changes_wakes_its_own_pods_alone_where_hardware_was_missing() -> None:
    queueing_hint = RegisteredPlugin(HardwareAffinityFilter()).queueing_hint
    event = Event("robotapps", Change.APPS, None, RobotApp(metadata=Metadata(uid="app")))
    assert [queueing_hint.wants(pod, event) for pod in (bare(), member())] == [False, True]
    assert queueing_hint.wants(bare(), Event("nodes", Change.LABELS, make_pod("n"), make_pod("n")))


def test_an_app_s_pod_without_its_claim_waits_for_that_claim_or_its_app() -> None:
    queueing_hint = HINTS[BIND_CHECK]
    named = member()
    named.annotations = {str(Annotation.DOMAIN_CLAIM): "dds.default.c.7"}
    events = [changed(None, domain(7)), changed(None, domain(8)), changed(None, claim())]
    assert [queueing_hint.wants(named, event) for event in events] == [True, False, False]
    assert [queueing_hint.wants(member(), event) for event in events] == [True, True, False]
    assert not queueing_hint.wants(member(), changed(None, domain(8, uid="another")))
    apps = [Event("robotapps", Change.APPS, None, RobotApp(metadata=Metadata(uid=uid))) for uid in ("app", "b")]
    assert [queueing_hint.wants(named, event) for event in apps] == [True, False]
    assert not queueing_hint.wants(named, gone())


def test_a_pod_that_changed_itself_is_tried_again() -> None:
    event = Event("pods", Change.SELF, make_pod("bare"), make_pod("bare", annotations={"a": "b"}))
    for queueing_hint in (RESERVE, HINTS[BIND_CHECK], HINTS[FULL_POOL]):
        assert queueing_hint.wants(bare(), event)
        assert queueing_hint.most(bare(), event) in {None, 1}
