"""The only thing kopf calls: remember the RobotApp, add a key. Nothing here can fail, so nothing can be lost."""

from collections.abc import Callable, Mapping
from typing import Any

import kopf

from robotapp_api.model.names import GROUP, VERSION
from robotapp_operator.queue.work import Work
from robotapp_operator.queue.workqueue import Key, Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.enqueue import enqueue_sharers


def register(registry: kopf.OperatorRegistry, report: Callable[[str | None, Mapping[str, Any]], None]) -> None:
    """Makes kopf call `report` with the type and the object of each event of a RobotApp."""

    @kopf.on.event(GROUP, VERSION, "robotapps", registry=registry)
    async def seen(event: Mapping[str, Any], **_: Any) -> None:
        report(event["type"], event["object"])


def observe(kind: str | None, body: Mapping[str, Any], cache: Cache, queue: Queue) -> None:
    """A status write (ours, mostly) only needs the status compared; everything else plans the app anew."""
    meta = body["metadata"]
    uid, key = meta["uid"], (meta.get("namespace", ""), meta["name"])
    if kind == "DELETED":
        cache.forget_app(uid)
        queue.add(Key(Work.APP, uid))
        queue.add(Key(Work.PROBES, ""), delay_s=1.0)
        enqueue_sharers(cache, queue, key)
        return
    after = cache.update_app(body)
    # Answers to our own reads and writes reach the cache before their event does: what counts is what was announced.
    if not cache.announce(after):
        queue.add(Key(Work.STATUS, uid))
        return
    queue.end_back_off(uid)  # what failed, failed with another spec
    queue.add(Key(Work.APP, uid))
    enqueue_sharers(cache, queue, key)
