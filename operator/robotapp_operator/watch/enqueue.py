"""Which keys a change adds to the queue: those of one instance, or of the apps that share a domain with it."""

from datetime import datetime
from typing import Final

from robotapp_claims.rules.share import AppKey
from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.lister import admitted_instances, finished_instances

FEW: Final = 2
"""Up to so many instances of an owner, a new or lost one may change what *every* instance of a sharer joins: the only
one there is stops being the only one, or becomes it."""

STATUS_DELAY_S: Final = 0.05
"""Pods of one app change in bursts; one status covers them."""
INSTANCE_DELAY_S: Final = 0.2


def enqueue_status(queue: Queue, uid: str, instance: str, *, delay_s: float = 0.0) -> None:
    """An observation of one instance changed: its RobotAppInstance and the app's status may have to be written."""
    queue.add(Key(Work.STATUS, uid), delay_s=delay_s + STATUS_DELAY_S)
    queue.add(Key(Work.INSTANCE, uid, instance), delay_s=delay_s + INSTANCE_DELAY_S)


def enqueue_sharers(cache: Cache, queue: Queue, owner: AppKey) -> None:
    """The app, its spec or what its templates name has changed: apps that share its domain are reconciled, in all instances."""
    for uid in cache.sharing.followers(owner):
        queue.end_back_off(uid)
        queue.add(Key(Work.APP, uid))


def enqueue_instance(cache: Cache, queue: Queue, uid: str, robot: str) -> None:
    """A domain claim of one instance came, went or changed its phase: the instance and its pods' gates are reconciled."""
    record = cache.apps.get(uid)
    if record is None:
        return
    queue.hurry(Key(Work.CHILDREN, uid, robot))
    if record.app is not None and not record.app.our_scheduler:
        queue.hurry(Key(Work.GATES, uid, robot))


def enqueue_joined(cache: Cache, queue: Queue, owner: AppKey, *, uid: str, instance: str) -> None:
    """What one instance of the owner holds or names has changed: the apps that join that instance are reconciled."""
    followers = cache.sharing.followers(owner)
    if not followers:
        return
    claims = cache.claims.of(uid).values()
    if len({claim.holder.instance for claim in claims if claim.spec.domain and claim.standing}) <= FEW:
        enqueue_sharers(cache, queue, owner)
        return
    for follower in followers:
        enqueue_instance(cache, queue, follower, instance)


def enqueue_next(cache: Cache, queue: Queue, uid: str, *, now: datetime, delay_s: float = 0.0) -> None:
    """Adds the instances of a sweep whose turn has come; nothing for another app."""
    record = cache.apps.get(uid)
    if record is None or record.app is None or record.app.spec.matrix is None:
        return
    for instance in admitted_instances(record.app, cache, now=now) - cache.running_instances(uid):
        queue.add(Key(Work.CHILDREN, uid, instance), delay_s=delay_s)
        enqueue_status(queue, uid, instance, delay_s=delay_s)


def enqueue_after_deadline(cache: Cache, queue: Queue, uid: str, instance: str, *, now: datetime) -> None:
    """Adds the instances whose turn has come, if this one has ended: no event shows that its deadline is over."""
    record = cache.apps.get(uid)
    app = record.app if record is not None else None
    completion = app.spec.completion if app is not None and app.spec.matrix is not None else None
    if app is None or completion is None or completion.deadline is None:
        return
    if instance in finished_instances(app, cache, now=now):
        enqueue_next(cache, queue, uid, now=now)
