"""ROSBind, the pure part: what a Binding carries so that grant and placement become visible in one write."""

from collections.abc import Iterable

from robotapp_api.model.names import Annotation
from robotapp_scheduler.core.devices import DeviceGrant


class ROSBind:
    """DefaultBinder with grants; the shell sends it with the pod's uid as precondition."""

    name = "ROSBind"

    def bind(self, grants: Iterable[DeviceGrant], domain: str | None) -> dict[str, str]:
        """Annotations of the Binding; empty for a pod that was granted nothing."""
        return binding_annotations(grants, domain)


def binding_annotations(grants: Iterable[DeviceGrant], domain: str | None) -> dict[str, str]:
    """granted.robotics.io/devices: sorted ids, comma separated; granted.robotics.io/dds-domain: the id of a bare pod."""
    found: dict[str, str] = {}
    ids = sorted(grant.device.id for grant in grants if grant.exclusive)
    if ids:
        found[str(Annotation.GRANTED_DEVICES)] = ",".join(ids)
    if domain is not None:
        found[str(Annotation.GRANTED_DOMAIN)] = domain
    return found
