"""What may help a pod that was refused by none of its profile's plugins, but by a name that stands for one."""

from typing import Final

from robotapp_scheduler.core.changes import Change, Event
from robotapp_scheduler.core.groups import (
    GROUP_EVENTS,
    GROUP_PLUGIN,
    POD_GROUP_EVENTS,
    POD_GROUP_PLUGIN,
    PREDECESSOR_PLUGIN,
    WHOLE_PLUGIN,
    WHOLE_READS,
    asks_otherwise,
)
from robotapp_scheduler.core.pods import PodInfo
from robotapp_scheduler.core.refusal import ANNOTATIONS, EXCESS, FULL_POOL
from robotapp_scheduler.core.waiting import Waker


def gives_domain_back(_: PodInfo, event: Event) -> bool:
    """Of five hundred that wait for a domain none is helped by a claim that comes, or by another pod."""
    return event.resource == "robotclaims" and event.new is None and event.old.spec.domain is not None


WAKERS: Final = {
    waker.plugin: waker
    for waker in (
        Waker(ANNOTATIONS, Change.NONE),
        Waker(EXCESS, Change.NONE),
        Waker(GROUP_PLUGIN, GROUP_EVENTS),
        Waker(PREDECESSOR_PLUGIN, GROUP_EVENTS),
        Waker(POD_GROUP_PLUGIN, POD_GROUP_EVENTS),
        Waker(WHOLE_PLUGIN, Change.APPS | Change.POD_GROUPS, asks_otherwise, WHOLE_READS),
        Waker(FULL_POOL, Change.CLAIMS | Change.POOLS, gives_domain_back),
    )
}
