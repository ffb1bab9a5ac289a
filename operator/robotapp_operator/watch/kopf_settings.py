"""kopf as informer and nothing more: no state of its own, no finalizer, no peering, no events."""

from typing import Any, Final

import kopf

from robotapp_api.model.names import GROUP

IDLE_S: Final = 0.05
"""kopf holds the last event of each object, as decoded JSON, for so long after it was handled: five seconds were two hundred
objects of twelve megabytes each.
"""


class NoProgress(kopf.ProgressStorage):
    """We have no change handlers, so there is no progress to remember; kopf's default would write annotations."""

    def fetch(self, **_: Any) -> None:
        return None

    def store(self, **_: Any) -> None:
        return None

    def purge(self, **_: Any) -> None:
        return None

    def touch(self, **_: Any) -> None:
        return None

    def clear(self, *, essence: Any) -> Any:
        return essence


class NoDiffBase(kopf.DiffBaseStorage):
    """Nor anything to compare with; this saves two deep copies per event."""

    def build(self, **_: Any) -> Any:
        return {}

    def fetch(self, **_: Any) -> None:
        return None

    def store(self, **_: Any) -> None:
        return None


def kopf_settings() -> kopf.OperatorSettings:
    settings = kopf.OperatorSettings()
    settings.persistence.finalizer = f"{GROUP}/operator"  # never set: there is no handler that needs one
    settings.persistence.progress_storage = NoProgress()
    settings.persistence.diffbase_storage = NoDiffBase()
    settings.peering.standalone = True
    settings.posting.enabled = False
    settings.scanning.disabled = True  # no rights on CRDs and namespaces needed; the CRDs are installed with us
    settings.watching.server_timeout = 300
    settings.watching.inactivity_timeout = 70
    settings.watching.initial_streaming = True
    settings.queueing.idle_timeout = IDLE_S
    settings.networking.request_timeout = 30
    settings.networking.connect_timeout = 5
    settings.networking.enforce_retry_after = True
    settings.networking.error_backoffs = (1.0, 2.0)  # then kopf ends, and AppWatch starts it again
    settings.process.ultimate_exiting_timeout = None  # it would kill the operator, whose loop this is not
    return settings
