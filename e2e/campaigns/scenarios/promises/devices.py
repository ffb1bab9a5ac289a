"""Thesis §4.4.4, second part: a device has one holder, and a bind that fails leaves none behind."""

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from tests.support.apiobjects import app, component
from tests.support.work_unit import slowness

from campaigns.rigs.appwatch import condition
from campaigns.scenarios.cluster import CAN, Json
from campaigns.scenarios.promises import domains
from campaigns.scenarios.promises.hardware import needs
from campaigns.scenarios.promises.place import Place, Verdict, judged
from campaigns.scenarios.promises.refused_bindings import refused
from robotapp_api.model.names import Annotation, Condition, Label
from robotapp_client.api.resources import PODS, ROBOTAPPS

RELEASE_S: Final = 2.0
"""From the deletion of a device's holder until the next one runs, where `slowness` is 1."""
YARDSTICK_S: Final = 0.3
ON_CAN: Final = needs(type=CAN.type, interface=CAN.interface)
NOT_HOME: Final = "the first holder is not on the node that has the device"
AT_ONCE: Final = "the second did not wait for the device"


def two_pods(place: Place) -> Verdict:
    """Two pods, one node with can0: the second waits, is told who holds it, and runs when the first is gone."""
    (home,) = place.cluster.labelled(*CAN.label)
    (first,) = place.create(place.pod("first", annotations=ON_CAN))
    place.until_bound([first])
    (second,) = place.create(place.pod("second", annotations=ON_CAN))
    place.until_settled([second])
    promises = {NOT_HOME: place.node_of(first) == home, AT_ONCE: not place.node_of(second)}
    if place.node_of(second):
        return judged(promises)
    place.until_told(second, f"{place.namespace}/{first}")
    return _handover(place, lambda: place.delete(first), lambda: place.stored(second), promises)


def two_apps(place: Place) -> Verdict:
    """The same with RobotApps: the second tells who holds the device, and runs when the first is deleted."""
    (home,) = place.cluster.labelled(*CAN.label)
    names = [f"{place.prefix}-{name}" for name in ("first", "second")]
    first, second = names
    _create_app(place, first)
    place.until(lambda: _runs(_pod_of(place, first)), what=lambda: _told(place, first))
    _create_app(place, second)
    place.until(lambda: f"{place.namespace}/{first}" in _told(place, second), what=lambda: _told(place, second))
    held_at = ((_pod_of(place, first) or {}).get("spec") or {}).get("nodeName")
    waiting = _pod_of(place, second)
    promises = {NOT_HOME: held_at == home, AT_ONCE: waiting is None or not waiting["spec"].get("nodeName")}

    def delete_first() -> None:
        place.cp.api.delete(ROBOTAPPS.path(place.namespace, first))

    return _handover(place, delete_first, lambda: _pod_of(place, second), promises)


def failed_binding(place: Place) -> Verdict:
    """The server refuses the binds of a pod: its claims stay its own, and go with it."""
    wants = ON_CAN | domains.wants("auto")
    with refused(place.cp, place.namespace):
        (unlucky,) = place.create(place.pod("unlucky", annotations=wants))
        place.until(
            lambda: len(place.claims()) > 1 and place.refusal(unlucky),
            what=lambda: f"{len(place.claims())} claims, {place.told(unlucky)}",
        )
        holders = [each["spec"]["holder"]["uid"] for each in place.claims()]
        own, bound = [place.uid(unlucky)] * 2, place.node_of(unlucky)
        place.delete(unlucky)
        place.until(lambda: not place.claims(), what=lambda: f"claims are left: {place.claims()}")
    (lucky,) = place.create(place.pod("lucky", annotations=wants))
    place.until_bound([lucky])
    return judged(
        {
            "a pod was bound although the server refused": not bound,
            f"the waiting pod has claims of {holders}, not one domain and one device of its own": holders == own,
            "the next pod was not granted the device": place.granted(lucky, Annotation.GRANTED_DEVICES) == CAN.id,
        }
    )


def _handover(
    place: Place, release: Callable[[], None], second: Callable[[], Json | None], promises: Mapping[str, bool]
) -> Verdict:
    """Release the device and time how long it takes until the second holder runs, beside this machine's own work."""
    slow_before = slowness(seconds=YARDSTICK_S)
    began_s = time.monotonic()
    release()
    place.until(lambda: _runs(second()), what=lambda: "the second does not run after the first is gone")
    took_s = time.monotonic() - began_s
    allowed_s = RELEASE_S * max(slow_before, slowness(seconds=YARDSTICK_S))
    in_time = {f"the second ran {took_s:.2f} s after the release, {allowed_s:.2f} s are allowed": took_s <= allowed_s}
    return judged({**promises, **in_time}, handover_ms=round(1000 * took_s), allowed_ms=round(1000 * allowed_s))


def _create_app(place: Place, name: str) -> None:
    driver = component("driver", devices=[{"name": "bus", "type": CAN.type, "interface": CAN.interface}])
    body = app(name, components=[driver])
    body["metadata"]["namespace"] = place.namespace
    place.cp.api.create(ROBOTAPPS.path(place.namespace), body)


def _pod_of(place: Place, name: str) -> Json | None:
    pods = place.watch.all(PODS, place.namespace)
    return next((each for each in pods if each["metadata"].get("labels", {}).get(str(Label.APP)) == name), None)


def _runs(pod: Mapping[str, Any] | None) -> bool:
    return pod is not None and pod.get("status", {}).get("phase") == "Running"


def _told(place: Place, name: str) -> str:
    """What the app's status, its pod and the Events about that tell of the device."""
    stored = place.watch.get(ROBOTAPPS, f"{place.namespace}/{name}") or {}
    pod = _pod_of(place, name)
    by_pod = place.told(pod["metadata"]["name"]) if pod else ""
    return f"{condition(stored, Condition.ALLOCATED).get('message', '')}\n{by_pod}"
