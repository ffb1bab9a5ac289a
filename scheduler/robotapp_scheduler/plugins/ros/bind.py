"""The bind plugins, as names of a configuration: the Binding itself is sent by the shell, with the pod's uid as
precondition, and carries whatever was granted, so that grant and placement become visible in one write.
"""

from collections.abc import Collection

from robotapp_api.claims.identity import grants


class ROSBind:
    """Binds, and tells the pod what it was given."""

    name = "ROSBind"

    def bind(self, *, domain: int | None = None, devices: Collection[str] = ()) -> dict[str, str]:
        """Annotations of the Binding; empty for a pod that was granted nothing."""
        return grants(domain=domain, devices=devices)


class DefaultBinder(ROSBind):
    """Upstream's name, so that a kube-scheduler's configuration can be carried over; grants are not left out."""

    name = "DefaultBinder"
