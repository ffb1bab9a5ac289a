"""The operator's CPU by what it is spent on."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from campaigns.scheduler.cpu_samples import Profile

_CONTROLLER: Final = "robotapp_operator.reconcile.controller:Controller"
EVENTS: Final = "robotapp_client.informer.reflector:Reflector._on_line"
PARTS: Final[Mapping[str, Sequence[str]]] = {
    "imports": ("importlib._bootstrap:",),
    "RobotApp events (kopf)": ("kopf.",),
    "other watch events": (EVENTS,),
    "lists at the start": ("robotapp_client.informer.reflector:Reflector._list",),
    "Deployments and Services": (f"{_CONTROLLER}._instance_children",),
    "RobotAppInstances": (f"{_CONTROLLER}._instance_object",),
    "status of the app": (f"{_CONTROLLER}._status",),
    "planning the app": (f"{_CONTROLLER}._app", f"{_CONTROLLER}._robots"),
    "fleet view": (f"{_CONTROLLER}._fleet_view",),
    "pairs to measure": (f"{_CONTROLLER}._probe",),
    "pools": (f"{_CONTROLLER}._pool", f"{_CONTROLLER}._waiting"),
    "sweep of claims": ("robotapp_claims.protocol.sweeper:", "robotapp_claims.protocol.domain_users:"),
    "ageing of round trips": ("robotapp_operator.watch.informers:Informers.expire",),
    "events that are written": ("robotapp_client.tools.event_recorder:",),
    "queue and metrics": ("robotapp_operator.queue.workqueue:", "robotapp_operator.reconcile.controller:"),
    "reading sockets": ("robotapp_client.transport", "asyncio.sslproto:"),
    "event loop": ("asyncio.",),
}
_SHOWN: Final = 150


def costs(profile: Profile, *, writes: Mapping[str, int], instances: int) -> dict[str, Any]:
    """What an event, an instance and a write of a status cost; `writes` by kind. Of a run from the start of the process."""
    found = profile.by_part(PARTS)
    statuses = _sum(writes, "robotapps/")
    objects = _sum(writes, "robotappinstances")
    return {
        "cpu_of_the_process_s": profile.cpu_s,
        "watch_events": float(profile.calls.get(EVENTS, 0)),
        "us_per_watch_event": found["other watch events"] * 1e6 / max(1, profile.calls.get(EVENTS, 0)),
        "ms_for_the_children_of_an_instance": found["Deployments and Services"] * 1000 / instances,
        "ms_per_write_of_an_instance_object": found["RobotAppInstances"] * 1000 / max(1, objects),
        "ms_per_write_of_a_status": found["status of the app"] * 1000 / max(1, statuses),
        "calls": dict(profile.calls),
        "parts_s": {name: round(seconds, 3) for name, seconds in found.items()},
        "inclusive_s": {name: round(seconds, 3) for name, seconds in profile.inclusive(_SHOWN * 2).items()},
        "own_s": {name: round(seconds, 3) for name, seconds in profile.own(_SHOWN).items()},
    }


def _sum(writes: Mapping[str, int], kind: str) -> int:
    return sum(count for name, count in writes.items() if kind in name)
