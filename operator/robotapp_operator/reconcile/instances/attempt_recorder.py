"""Reads and writes the record of an instance's attempts, which stands in the status of its RobotAppInstance."""

from typing import Any

import msgspec

from robotapp_client import ApiClient, Conflict, NotFound
from robotapp_client.api.resources import ROBOTAPPINSTANCES
from robotapp_client.transport.errors import means_gone
from robotapp_operator.plan.diff.attempts import COMPLETION_TIME_FIELD, RESTARTS_FIELD, Attempt, render_attempt
from robotapp_operator.plan.render.instance_object import AppInstance, is_as_wanted, object_name
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.queue.work import StartOver
from robotapp_operator.watch.cache import Cache


class AttemptRecorder:
    """Writes are conditional on the version that was read, so that of two operators one records the next attempt."""

    def __init__(self, client: ApiClient, cache: Cache) -> None:
        self._client = client
        self._cache = cache

    async def read(self, app: App, instance: str) -> AppInstance | None:
        """Returns the RobotAppInstance as it is now, None where there is none that is the instance's."""
        name = object_name(app.name, instance)
        try:
            item = await self._client.get(ROBOTAPPINSTANCES, name, namespace=app.namespace, as_type=AppInstance)
        except NotFound as error:
            if not means_gone(error, name):
                raise
            return None
        is_going = item.metadata.deletion_timestamp is not None
        return item if is_as_wanted(item, app, instance) and not is_going else None

    async def record(self, item: AppInstance, attempt: Attempt) -> AppInstance:
        """Writes the attempt beside what the status has, and returns the object as stored. Raises StartOver when it has changed.

        The time of an end that was before is left out: it would begin the count anew.
        """
        meta = item.metadata
        status: dict[str, Any] = {key: value for key, value in item.status.items() if key != COMPLETION_TIME_FIELD}
        body = {
            "metadata": {"name": meta.name, "namespace": meta.namespace, "resourceVersion": meta.resource_version},
            "status": status | {RESTARTS_FIELD: render_attempt(attempt)},
        }
        try:
            answer = await self._client.apply(ROBOTAPPINSTANCES, body, subresource="status")
        except (NotFound, Conflict) as race:
            raise StartOver(str(race)) from race
        app_instance = msgspec.convert(answer, AppInstance)
        self._cache.put_instance_object(app_instance)
        return app_instance
