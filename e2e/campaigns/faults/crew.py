"""The scheduler processes of one run: started, restarted when they end, and counted, as a Deployment would."""

import asyncio
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Self
from urllib.error import URLError
from urllib.request import urlopen

from prometheus_client.parser import text_string_to_metric_families

from campaigns.common.process_use import peak_rss_bytes
from robotapp_testbed.control_plane.servers import unverified
from robotapp_testbed.processes.process import Process

LOST_LEADERSHIP = 1
_WATCH_S = 0.2


@dataclass(slots=True)
class Member:
    """One scheduler and what its lives used so far."""

    process: Process
    exits: Counter[int] = field(default_factory=Counter)
    killed: int = 0
    """SIGKILLs of ours that have not been answered by a restart yet."""
    peak_rss_bytes: int = 0
    stays_down: bool = False
    """Not restarted for now."""
    _cpu_before_s: float = 0.0
    _cpu_s: float = 0.0

    def look(self) -> None:
        with suppress(OSError):
            self.peak_rss_bytes = max(self.peak_rss_bytes, peak_rss_bytes(self.process.pid))
        self._cpu_s = max(self._cpu_s, self.process.cpu_seconds())

    def restarted(self) -> None:
        self._cpu_before_s += self._cpu_s
        self._cpu_s = 0.0

    @property
    def cpu_s(self) -> float:
        return self._cpu_before_s + self._cpu_s

    def metrics(self) -> dict[str, dict[tuple[str, ...], float]]:
        """Families by name, samples by label values; empty when it does not answer."""
        url = f"{self.process.health_url}/metrics"
        try:
            with urlopen(url, timeout=10, context=unverified()) as answer:  # noqa: S310 - our own
                text = answer.read().decode()
        except (URLError, OSError):
            return {}
        found: dict[str, dict[tuple[str, ...], float]] = {}
        for family in text_string_to_metric_families(text):
            for sample in family.samples:
                found.setdefault(sample.name, {})[tuple(sample.labels.values())] = sample.value
        return found


class Crew:
    """All members; while entered, whoever ends is started again and every unexpected exit is a problem."""

    def __init__(self, start: Callable[[int], Process], count: int) -> None:
        self.members = [Member(start(number)) for number in range(count)]
        self.problems: list[str] = []
        self.restarts = 0

    async def __aenter__(self) -> Self:
        self._task = asyncio.create_task(self._watch())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        for member in self.members:
            await asyncio.to_thread(member.process.stop)
            text = member.process.log_text()
            if "Traceback" in text:
                self.problems.append(f"a stack: {text[max(0, text.index('Traceback') - 300) :][:3000]}")

    def kill(self, member: Member) -> None:
        member.look()
        member.killed += 1
        member.process.kill()

    @property
    def cpu_s(self) -> float:
        return sum(member.cpu_s for member in self.members)

    @property
    def peak_rss_bytes(self) -> int:
        return max(member.peak_rss_bytes for member in self.members)

    async def _watch(self) -> None:
        while True:
            for member in self.members:
                if member.process.running:
                    member.look()
                elif not member.stays_down:
                    self._revive(member)
            await asyncio.sleep(_WATCH_S)

    def _revive(self, member: Member) -> None:
        code = member.process.returncode
        if member.killed:
            member.killed -= 1
        elif code is not None:
            member.exits[code] += 1
            if code != LOST_LEADERSHIP:
                self.problems.append(f"{member.process.name} ended with {code}, see {member.process.log_path}")
        member.restarted()
        self.restarts += 1
        member.process.start()
