"""Checks of a DomainPool: what of it has no effect yet."""

from collections.abc import Iterator

from robotapp_api.checks.problem import Note
from robotapp_api.model.pool import DEFAULT_PARTICIPANTS


def pool_notes(*, max_participants_per_host: int) -> Iterator[Note]:
    """Fields that are stored and have no effect yet, unless they have their default."""
    if max_participants_per_host != DEFAULT_PARTICIPANTS:
        text = f"{max_participants_per_host} has no effect yet; no pod is refused because of it"
        yield Note("spec.maxParticipantsPerHost", text)
