"""The configuration while the process runs: a new text is checked as a whole, then swapped in between two cycles, or refused.

Texts with mistakes are refused, and those that change what cannot change while the process runs (scheduler names, leader election,
the API server): the old configuration stays in use, and an Event, a metric and /configz show the reason.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Any, Final

from robotapp_api.model.names import EventReason
from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.config.load import ConfigError, LeaderElection, SchedulerConfig
from robotapp_scheduler.config.model import API_VERSION, KIND
from robotapp_scheduler.core.framework.profiles import Catalogue, Profile, ProfileSpec, expand
from robotapp_scheduler.shell.config.sources import Given, LastGood, NoSource, Source

log = logging.getLogger(__name__)

MOST_NOTE: Final = 900


class Outcome(StrEnum):
    """What became of a text; values of the `result` label of scheduler_config_reloads_total."""

    SWAPPED = "swapped"
    UNCHANGED = "unchanged"
    INVALID = "invalid"
    RESTART_NEEDED = "restart_needed"


Swap = Callable[[SchedulerConfig, Mapping[str, Profile]], None]
"""Put a configuration with its ready profiles to work; called in the event loop, between two cycles."""
ReportEvent = Callable[[str, str, bool], None]
"""(reason, note, warning): one event."""


class Running:
    """The configuration in use, where it came from, and what is wrong with the one that was given last."""

    def __init__(self, config: SchedulerConfig, *, text: str = "", refused: tuple[str, ...] = ()) -> None:
        self.config = config
        self.text = text
        """What it was read from; empty for the built-in one."""
        self.refused = refused
        """Problems of the text given last; empty while that is the one in use."""
        self.outcomes = dict.fromkeys(Outcome, 0)
        self.since_s = time.time()

    def __repr__(self) -> str:
        return f"<Running {self.config.digest}{', the given one is refused' if self.refused else ''}>"

    def as_json(self) -> dict[str, Any]:
        """For /configz."""
        return document(self.config) | {"digest": self.config.digest, "refused": list(self.refused)}


class Reloader:
    """Follows a source. `run` until cancelled; `leading` is for the leader alone, once."""

    def __init__(
        self,
        running: Running,
        source: Source,
        *,
        catalogue: Catalogue,
        swap: Swap,
        report: ReportEvent,
        last_good: LastGood | None,
    ) -> None:
        self.running = running
        self._source = source
        self._catalogue = catalogue
        self._swap = swap
        self._report = report
        self._last_good = last_good
        self._given: Given | None = None
        self._woken = asyncio.Event()

    def __repr__(self) -> str:
        return f"<Reloader of {self._source!r}: {self.running!r}>"

    async def run(self) -> None:
        """Follow the source until cancelled."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._source.follow(self._seen), name="configuration source")
            while True:
                await self._woken.wait()
                self._woken.clear()
                if self._given is not None:
                    await self.take(self._given)

    def _seen(self, given: Given) -> None:
        self._given = given
        self._woken.set()

    async def take(self, given: Given) -> Outcome:
        """Use or refuse what is given now. Nobody waits for it: the old configuration works meanwhile."""
        running = self.running
        if given.text == running.text and not given.problem and not running.refused:
            return Outcome.UNCHANGED
        outcome = await self._decided(given)
        running.outcomes[outcome] += 1
        return outcome

    async def _decided(self, given: Given) -> Outcome:
        try:
            # Somebody else's modules may be imported here: not in the loop that places pods.
            config, profiles = await asyncio.to_thread(ready, given, self._catalogue)
        except ConfigError as error:
            return self._reject(Outcome.INVALID, error.problems)
        running = self.running
        fixed = running.config.restart_needed(config)
        if fixed:
            return self._reject(Outcome.RESTART_NEEDED, [f"{path}: cannot change while running" for path in fixed])
        before = running.config
        running.text, running.refused = given.text, ()
        if config == before:
            log.info("the configuration given now is the one in use, %s", config.digest)
            await self.keep()
            return Outcome.UNCHANGED
        for warning in config.warnings:
            log.warning("%s", warning)
        self._swap(config, profiles)
        running.config, running.since_s = config, time.time()
        note = f"{self._source!r}: configuration {config.digest} is in use, {before.digest} no longer"
        log.info("%s", note)
        self._report(EventReason.CONFIG_RELOADED, note, False)
        await self.keep()
        return Outcome.SWAPPED

    async def leading(self) -> None:
        """We lead now: what is in use is what must be found at the next start, and observers must see it."""
        if self.running.refused:
            self._report(EventReason.CONFIG_INVALID, self._rejection("cannot be used", self.running.refused), True)
        await self.keep()

    async def keep(self) -> None:
        """Write down the configuration in use as the last good one."""
        if self._last_good is not None and self.running.text:
            await self._last_good.write(self.running.text)

    def _reject(self, outcome: Outcome, problems: "tuple[str, ...] | list[str]") -> Outcome:
        if self.running.refused == tuple(problems):
            return outcome
        self.running.refused = tuple(problems)
        needed = outcome is Outcome.RESTART_NEEDED
        what = "is good, but needs a restart" if needed else "cannot be used"
        note = self._rejection(what, problems)
        log.error("%s", note)
        reason = EventReason.CONFIG_RESTART_NEEDED if needed else EventReason.CONFIG_INVALID
        self._report(reason, note, True)
        return outcome

    def _rejection(self, what: str, problems: "tuple[str, ...] | list[str]") -> str:
        note = f"{self._source!r} {what}; {self.running.config.digest} stays in use: {'; '.join(problems)}"
        return note[:MOST_NOTE]


def ready(given: Given, catalogue: Catalogue) -> tuple[SchedulerConfig, Mapping[str, Profile]]:
    """The configuration with its plugins made. Raises `ConfigError`."""
    if given.problem:
        raise ConfigError([given.problem])
    try:
        config = configuration.parse_text(given.text, catalogue=catalogue)
        return config, config.build()
    except ConfigError:
        raise
    except Exception as error:  # a text must never end the process that places pods; the log has the stack
        log.exception("reading a configuration failed")
        raise ConfigError([f"internal error: {type(error).__name__}: {error}"]) from error


async def first(source: Source, catalogue: Catalogue, last_good: LastGood | None) -> Running:
    """What to start with: the given configuration, else, with a warning, the last good one. Raises `ConfigError`."""
    if isinstance(source, NoSource):
        return Running(configuration.built_in(catalogue))
    given = await source.read()
    try:
        config, _ = ready(given, catalogue)
        return Running(config, text=given.text)
    except ConfigError as error:
        if last_good is None:
            raise
        kept = await last_good.read()
        try:
            config, _ = ready(kept, catalogue)
        except ConfigError as second:
            log.warning("%r cannot be used either: %s", last_good, second)
            raise error from second
        log.warning("%r cannot be used: %s; started with the last good one, %s", source, error, config.digest)
        return Running(config, text=kept.text, refused=error.problems)


def document(config: SchedulerConfig) -> dict[str, Any]:
    """A configuration as `/configz` shows it: a file that leaves nothing to defaults and can be used again."""
    catalogue = config.catalogue.with_defaults_for(config.profiles)
    return {
        "apiVersion": API_VERSION,
        "kind": KIND,
        "compatVersion": config.compat_version,
        "percentageOfNodesToScore": 100,
        "podInitialBackoffSeconds": int(config.initial_backoff_s),
        "podMaxBackoffSeconds": int(config.max_backoff_s),
        "clientConnection": {"kubeconfig": config.kubeconfig},
        "leaderElection": _election(config.leader_election),
        "profiles": [_profile(spec, catalogue) for spec in config.profiles],
    }


def _profile(spec: ProfileSpec, catalogue: Catalogue) -> dict[str, Any]:
    points = expand(spec.plugins, catalogue, "", [])
    return {
        "schedulerName": spec.scheduler_name,
        "plugins": {
            point: {
                "enabled": [
                    {"name": ref.name, "weight": ref.weight or 1} if point == "score" else {"name": ref.name}
                    for ref in refs
                ],
                "disabled": [{"name": "*"}],
            }
            for point, refs in points.items()
        },
        "pluginConfig": [{"name": name, "args": dict(args)} for name, args in spec.plugin_config.items()],
    }


def _election(election: LeaderElection) -> dict[str, Any]:
    return {
        "leaderElect": election.enabled,
        "leaseDuration": _duration(election.lease_s),
        "renewDeadline": _duration(election.renew_s),
        "retryPeriod": _duration(election.retry_s),
        "resourceLock": "leases",
        "resourceName": election.name,
        "resourceNamespace": election.namespace,
    }


def _duration(seconds: float) -> str:
    return f"{seconds:.6f}".rstrip("0").rstrip(".") + "s"
