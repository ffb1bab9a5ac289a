"""Gives back the allocations of RobotApps that need them no longer, as `core.dynamic_resources.standing_consumers` decides."""

import logging

from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import ROBOTAPPS
from robotapp_client.transport.errors import ClientError, Conflict, NotFound, means_gone
from robotapp_scheduler.core.api.robotics_v1alpha1 import RobotApp
from robotapp_scheduler.core.cache.cache import Cache
from robotapp_scheduler.core.dynamic_resources.objects import ResourceClaim
from robotapp_scheduler.core.dynamic_resources.standing_consumers import (
    find_release_reason,
    find_standing_app,
    is_standing,
)
from robotapp_scheduler.core.robotics.app_index import read_app
from robotapp_scheduler.shell.binding.claim_writer import ClaimWriter, UnwritableError

log = logging.getLogger(__name__)

TICK_S = 1.0


class StandingClaims:
    """`run` on the leader. What could not be written is decided again at the next tick."""

    def __init__(self, client: ApiClient, cache: Cache, writer: ClaimWriter) -> None:
        self._client = client
        self._cache = cache
        self._writer = writer

    def __repr__(self) -> str:
        return f"<StandingClaims of {self._cache.resource_claims!r}>"

    async def run(self) -> None:
        """Look at all claims with a standing consumer until cancelled."""
        while True:
            await self._client.sleep(TICK_S)
            for claim in [claim for claim in self._cache.resource_claims.list_claims() if is_standing(claim)]:
                await self.review(claim)

    async def review(self, claim: ResourceClaim) -> None:
        """Give back the claim's allocation if there is a reason to.

        The app is read last, and the write is for the version of the claim that was looked at: what happened to either meanwhile
        keeps the device. With a cached app, one that was resumed and whose pod just ended would lose it to a rival.
        """
        if not self._find_reason(claim, self._find_cached_app(claim)):
            return
        reason = ""
        try:
            reason = self._find_reason(claim, await self._read_app(claim))
            if not reason:
                return
            await self._writer.free(claim)
        except Conflict:
            return  # it changed meanwhile: the next tick sees how
        except (ClientError, UnwritableError) as error:
            log.warning(
                "resource claim %s is not given back (%s): %s", claim, reason or "its app cannot be read", error
            )
            return
        log.info("resource claim %s is given back: %s", claim, reason)

    def _find_reason(self, claim: ResourceClaim, app: RobotApp | None) -> str:
        if ROBOTAPPS.plural in self._cache.unseen_kinds:
            return ""
        row_of = self._cache.nodes.row_of
        return find_release_reason(claim, app, exists=lambda name: name in row_of)

    def _find_cached_app(self, claim: ResourceClaim) -> RobotApp | None:
        owner = find_standing_app(claim)
        app = self._cache.apps.app(owner[1]) if owner is not None else None
        return app.source if app is not None else None

    async def _read_app(self, claim: ResourceClaim) -> RobotApp | None:
        """The claim's app as the API server has it now, None when it is gone. Raises ClientError."""
        owner = find_standing_app(claim)
        if owner is None:
            return None
        try:
            app = await self._client.get(ROBOTAPPS, owner[0], namespace=claim.metadata.namespace, as_type=RobotApp)
        except NotFound as error:
            if means_gone(error, owner[0]):
                return None
            raise
        return read_app(app).source
