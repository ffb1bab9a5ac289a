"""A stand-in for the writer of volume decisions, for tests of what comes after it."""

import asyncio

from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.volumes.volume_cache import VolumePlan


class ScriptedVolumes:
    """Volumes that are bound at once, or not before `ready`, or never, for a reason."""

    def __init__(self) -> None:
        self.trouble = ""
        self.ready = asyncio.Event()
        self.ready.set()
        self.asked: list[str] = []
        self.entered: list[str] = []
        """Pods that were to become users of their resource claims."""

    async def enter(self, pod: PodInfo) -> str:
        self.entered.append(pod.name)
        return self.trouble

    async def bind(self, pod: PodInfo, _plan: VolumePlan) -> str:
        self.asked.append(pod.name)
        await self.ready.wait()
        return self.trouble
