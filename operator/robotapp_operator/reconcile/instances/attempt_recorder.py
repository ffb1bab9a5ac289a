"""Reads and writes the record of an instance's attempts (`plan.diff.attempts`) in the status of its
RobotAppInstance.
"""

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
    """Records attempts, on condition of the version that was read: of two operators one records the next attempt."""

    def __init__(self, client: ApiClient, cache: Cache) -> None:
        self._client = client
        self._cache = cache

    async def read(self, app: App, instance: str) -> AppInstance | None:
        """Reads the RobotAppInstance of the instance; None where there is none, or one that is being deleted or is
        not as it should be.
        """
        name = object_name(app.name, instance)
        try:
            item = await self._client.get(ROBOTAPPINSTANCES, name, namespace=app.namespace, as_type=AppInstance)
        except NotFound as error:
            if not means_gone(error, name):
                raise
            return None
        is_deleting = item.metadata.deletion_timestamp is not None
        return item if is_as_wanted(item, app, instance) and not is_deleting else None

    async def record(self, item: AppInstance, attempt: Attempt) -> AppInstance:
        """Adds the attempt to the status, and returns the object as stored. Raises StartOver if it was changed since it
        was read.

        The time of an earlier end is left out: with it the count of restarts would begin anew.
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
