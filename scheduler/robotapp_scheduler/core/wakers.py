"""What may help a pod that was refused by none of its profile's plugins, but by a name that stands for one."""

from typing import Final

from robotapp_api.claims.objects import Claim
from robotapp_api.model.names import Annotation
from robotapp_scheduler.core.events.cluster_event import Change, Event
from robotapp_scheduler.core.framework.queueing_hint import Waker
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
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.refusal import ANNOTATIONS, BIND_CHECK, EXCESS, FULL_POOL


def gives_domain_back(_: PodInfo, event: Event) -> bool:
    """Of five hundred that wait for a domain none is helped by a claim that comes, or by another pod."""
    if event.change & Change.SELF:
        return True
    return event.resource == "robotclaims" and event.new is None and event.old.spec.domain is not None


def serves_one(_: PodInfo, __: Event) -> int:
    """An id that was given back is taken by one of them."""
    return 1


def about_its_domain(pod: PodInfo, event: Event) -> bool:
    """A claim of the domain that an app's pod names, or its own app, is another than before; pods with forged labels wait for ever."""
    if event.change & Change.SELF:
        return True
    if event.resource == "robotapps":
        return pod.member is not None and pod.member.app_uid == (event.new or event.old).metadata.uid
    claim: Claim = event.new or event.old
    if claim.spec.domain is None:
        return False
    named = pod.annotations.get(Annotation.DOMAIN_CLAIM, "")
    return claim.name == named if named else pod.member is not None and pod.member.app_uid == claim.holder.uid


WAKERS: Final = {
    waker.plugin: waker
    for waker in (
        Waker(ANNOTATIONS, Change.NONE),
        Waker(EXCESS, Change.NONE),
        Waker(GROUP_PLUGIN, GROUP_EVENTS),
        Waker(PREDECESSOR_PLUGIN, GROUP_EVENTS),
        Waker(POD_GROUP_PLUGIN, POD_GROUP_EVENTS),
        Waker(WHOLE_PLUGIN, Change.APPS | Change.POD_GROUPS, asks_otherwise, WHOLE_READS),
        Waker(BIND_CHECK, Change.CLAIMS | Change.APPS | Change.POOLS, about_its_domain, ("annotations", "group")),
        # Those that want no devices have a turn of their own: an id is not passed by pods whose devices are taken.
        Waker(FULL_POOL, Change.CLAIMS | Change.POOLS, gives_domain_back, ("annotated_hardware",), serves=serves_one),
    )
}
