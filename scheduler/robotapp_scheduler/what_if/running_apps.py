"""Apps that run under the name of one that is tried: their pods give way, and the new ones are compared with them."""

from collections.abc import Collection, Iterable
from typing import NamedTuple

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.pods.pod_info import Member
from robotapp_scheduler.core.robotics.app_index import App, InstanceKey


class FormerPod(NamedTuple):
    """A pod that gave way; `node` is "" for one that waited."""

    pod: Pod
    node: str


def running_apps(names: Collection[tuple[str, str]], cluster: Cache) -> dict[tuple[str, str], App]:
    """The apps of these namespaces and names that have a pod."""
    found = {}
    for app_uid in dict.fromkeys(app_uid for app_uid, _ in cluster.apps.instances()) if names else ():
        app = cluster.apps.app(app_uid)
        if app is not None and (key := (app.source.metadata.namespace, app.source.metadata.name)) in names:
            found[key] = app
    return found


def instances_of(apps: Iterable[App], cluster: Cache) -> list[InstanceKey]:
    """The instances of these apps that have a pod."""
    uids = {app.uid for app in apps}
    return [instance for instance in cluster.apps.instances() if instance[0] in uids] if uids else []


def take_away(apps: Iterable[App], cluster: Cache) -> dict[Member, list[FormerPod]]:
    """Remove the pods of the apps' components. Their servers stay."""
    found: dict[Member, list[FormerPod]] = {}
    for app in apps:
        for instance in [each for uid, each in cluster.apps.instances() if uid == app.uid]:
            for name in app.components:
                member = Member(app.uid, instance, name)
                former = [FormerPod(each.pod, each.node) for each in cluster.apps.replicas(member, name)]
                found[member] = former
                for each in former:
                    cluster.remove_pod(each.pod)
    return found
