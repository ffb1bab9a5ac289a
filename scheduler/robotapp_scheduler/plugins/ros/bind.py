"""The bind plugins: one Binding with the pod's uid as precondition and all grants as annotations, so that grant and node
become visible in one write.
"""

from collections.abc import Callable

from robotapp_scheduler.core.framework.handle import BindOutcome
from robotapp_scheduler.core.framework.interface import BindContext
from robotapp_scheduler.core.pods.pod_info import PodInfo


class ROSBind:
    """Binds the pod, with its grants as annotations of the Binding."""

    name = "ROSBind"

    def send(self, pod: PodInfo, node: str, ctx: BindContext, done: Callable[[Exception | None], None]) -> None:
        """The first try of `bind` for a pod that was granted nothing; `done` is called with its result."""
        ctx.handle.pods.send(pod.pod, node, done)

    async def bind(self, pod: PodInfo, node: str, ctx: BindContext) -> BindOutcome:
        """Send the Binding with every grant and annotation, and find out whether it took effect."""
        return await ctx.handle.pods.bind(
            pod.pod,
            node,
            annotations=ctx.binding_annotations,
            resource_version=ctx.reserved.resource_version,
            refused=ctx.refused,
        )


class DefaultBinder(ROSBind):
    """ROSBind under upstream's name, so that a configuration of kube-scheduler can be used. Grants are written all the same."""

    name = "DefaultBinder"
