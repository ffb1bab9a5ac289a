"""The bind plugins: one Binding with the pod's uid as precondition. It carries whatever was granted, so that grant and
placement become visible in one write.
"""

from collections.abc import Callable

from robotapp_scheduler.core.framework.handle import BindOutcome
from robotapp_scheduler.core.framework.interface import BindContext
from robotapp_scheduler.core.pods.pod_info import PodInfo


class ROSBind:
    """Binds, and tells the pod what it was given."""

    name = "ROSBind"

    def send(self, pod: PodInfo, node: str, ctx: BindContext, done: Callable[[Exception | None], None]) -> None:
        """The first try of `bind` for a pod that was granted nothing; `done` is called with its result."""
        ctx.handle.pods.send(pod.pod, node, done)

    async def bind(self, pod: PodInfo, node: str, ctx: BindContext) -> BindOutcome:
        """Send the Binding with every grant and annotation, and find out what became of it."""
        return await ctx.handle.pods.bind(
            pod.pod,
            node,
            annotations=ctx.binding_annotations,
            resource_version=ctx.reserved.resource_version,
            refused=ctx.refused,
        )


class DefaultBinder(ROSBind):
    """Upstream's name, so that a kube-scheduler's configuration can be carried over; grants are not left out."""

    name = "DefaultBinder"
