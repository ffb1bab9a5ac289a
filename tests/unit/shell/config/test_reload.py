"""A configuration exchanged while running: swapped as a whole or refused, and the last good one kept."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for, configmap, until

from robotapp_client.api.resources import CONFIGMAPS
from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.config.flags import parse
from robotapp_scheduler.config.load import ConfigError, SchedulerConfig
from robotapp_scheduler.core.framework.profiles import Profile
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.shell.config.reload import Outcome, Reloader, Running, first
from robotapp_scheduler.shell.config.sources import FileSource, Given, LastGood, MapSource, NoSource, sources


def text(**fields: Any) -> str:
    head = {"apiVersion": "kubescheduler.config.k8s.io/v1", "kind": "KubeSchedulerConfiguration"}
    return yaml.safe_dump(head | fields)


def weights(**plugins: int) -> str:
    enabled = [{"name": name, "weight": weight} for name, weight in plugins.items()]
    return text(profiles=[{"plugins": {"multiPoint": {"enabled": enabled}}}])


class Bench:
    """A reloader whose swaps and events are written down."""

    def __init__(self, start: str, last_good: LastGood | None = None) -> None:
        config = configuration.parse_text(start, catalogue=catalogue())
        self.running = Running(config, text=start)
        self.swapped: list[tuple[SchedulerConfig, Mapping[str, Profile]]] = []
        self.told: list[tuple[str, str, bool]] = []
        self.reloader = Reloader(
            self.running,
            NoSource(),
            catalogue=catalogue(),
            swap=lambda config, profiles: self.swapped.append((config, profiles)),
            report=lambda *event: self.told.append(event),
            last_good=last_good,
        )

    async def take(self, given: str) -> Outcome:
        return await self.reloader.take(Given(given))


async def test_a_good_configuration_is_swapped_in_with_an_event() -> None:
    bench = Bench(weights(TopologyScore=10))
    before = bench.running.config.digest
    assert await bench.take(weights(TopologyScore=3)) is Outcome.SWAPPED
    ((config, profiles),) = bench.swapped
    assert bench.running.config is config
    assert {score.name: score.weight for score in profiles["ros-aware-scheduler"].scores}["TopologyScore"] == 3
    ((reason, note, warning),) = bench.told
    assert (reason, warning) == ("ConfigReloaded", False)
    assert before in note
    assert config.digest in note
    assert bench.running.outcomes[Outcome.SWAPPED] == 1


@pytest.mark.parametrize(
    ("given", "outcome", "reason", "said"),
    [
        (text(parallelism=0), Outcome.INVALID, "ConfigInvalid", "parallelism: Invalid value"),
        ("a: [", Outcome.INVALID, "ConfigInvalid", "strict decoding error"),
        (
            text(profiles=[{"schedulerName": "other"}]),
            Outcome.RESTART_NEEDED,
            "ConfigRestartNeeded",
            "profiles[].schedulerName: cannot change while running",
        ),
        (text(leaderElection={"leaderElect": False}), Outcome.RESTART_NEEDED, "ConfigRestartNeeded", "leaderElection"),
    ],
)
async def test_what_cannot_be_used_leaves_the_old_one_in_place_and_is_told_once(
    given: str, outcome: Outcome, reason: str, said: str
) -> None:
    bench = Bench(weights(TopologyScore=10))
    before = bench.running.config
    for _ in range(3):
        assert await bench.take(given) is outcome
    assert bench.running.config is before
    assert bench.swapped == []
    ((told, note, warning),) = bench.told
    assert (told, warning) == (reason, True)
    assert said in note
    assert any(said in problem for problem in bench.running.as_json()["refused"])


async def test_a_plugin_that_cannot_be_made_is_refused_like_any_other_mistake() -> None:
    bench = Bench(text())
    broken = text(profiles=[{"plugins": {"score": {"enabled": [{"name": "no.such.module:Plugin"}]}}}])
    assert await bench.take(broken) is Outcome.INVALID
    assert "cannot be loaded" in bench.told[0][1]


async def test_a_plugin_that_breaks_while_it_is_made_leaves_the_old_configuration_at_work() -> None:
    bench = Bench(text())
    broken = {"enabled": [{"name": "tests.support.scheduler.broken_plugins:CannotStart"}]}
    assert await bench.take(text(profiles=[{"plugins": {"multiPoint": broken}}])) is Outcome.INVALID
    assert "no route to the laboratory" in bench.told[0][1]
    assert bench.swapped == []


async def test_back_to_the_configuration_in_use_nothing_is_refused_any_more() -> None:
    start = weights(TopologyScore=10)
    bench = Bench(start)
    await bench.take("nonsense")
    assert bench.running.refused
    assert await bench.take(start) is Outcome.UNCHANGED
    assert bench.running.refused == ()
    assert bench.swapped == []


async def test_another_text_with_the_same_meaning_swaps_nothing() -> None:
    bench = Bench(text())
    assert await bench.take("# a comment\n" + text()) is Outcome.UNCHANGED
    assert bench.swapped == []
    assert bench.told == []


async def test_a_config_map_that_is_gone_is_refused() -> None:
    bench = Bench(text())
    assert await bench.reloader.take(Given(problem="deleted")) is Outcome.INVALID
    assert bench.running.refused == ("deleted",)


async def test_a_file_is_followed(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    seen: list[Given] = []
    task = asyncio.create_task(FileSource(path, poll_s=0.01).follow(seen.append))
    await until(lambda: seen, what="first state")
    path.write_text("a")
    await until(lambda: len(seen) == 2, what="the file")
    path.write_bytes(b"\xff")
    await until(lambda: len(seen) == 3, what="bad bytes")
    task.cancel()
    assert [bool(given.problem) for given in seen] == [True, False, True]
    assert seen[1] == Given("a")


async def test_a_config_map_is_followed_from_change_to_change() -> None:
    async with FakeApiServer() as server, client_for(server.endpoint) as client:
        source = MapSource(client, "default", "conf")
        assert (await source.read()).problem
        seen: list[Given] = []
        task = asyncio.create_task(source.follow(seen.append))
        await client.create(CONFIGMAPS, configmap("other", **{"scheduler.yaml": "not ours"}))
        await client.create(CONFIGMAPS, configmap("conf", **{"scheduler.yaml": "1"}))
        await until(lambda: seen, what="created")
        assert await source.read() == Given("1")
        await client.patch(CONFIGMAPS, "conf", {"data": {"scheduler.yaml": None}}, namespace="default")
        await until(lambda: len(seen) == 2, what="patched")
        await client.delete(CONFIGMAPS, "conf", namespace="default")
        await until(lambda: len(seen) == 3, what="deleted")
        task.cancel()
        assert seen == [Given("1"), Given(problem="has no key scheduler.yaml"), Given(problem="deleted")]
        assert source.regarding["name"] == "conf"


async def test_the_last_good_text_is_kept_and_used_at_the_next_start_when_the_given_one_is_bad() -> None:
    async with FakeApiServer() as server, client_for(server.endpoint) as client:
        await client.create(CONFIGMAPS, configmap("conf", **{"scheduler.yaml": "nonsense"}))
        await client.create(CONFIGMAPS, configmap("good"))
        given, kept = MapSource(client, "default", "conf"), LastGood(client, "default", "good")
        with pytest.raises(ConfigError, match="configuration"):
            await first(given, catalogue(), kept)
        bench = Bench(text(), kept)
        await bench.reloader.leading()
        assert await bench.take(weights(TopologyScore=3)) is Outcome.SWAPPED
        running = await first(given, catalogue(), LastGood(client, "default", "good"))
        assert running.config.digest == bench.running.config.digest
        assert running.refused


async def test_who_starts_to_lead_with_the_last_good_one_says_so() -> None:
    bench = Bench(text())
    bench.running.refused = ("parallelism: wrong",)
    await bench.reloader.leading()
    ((reason, note, warning),) = bench.told
    assert (reason, warning) == ("ConfigInvalid", True)
    assert "parallelism: wrong" in note


async def test_a_last_good_map_that_does_not_exist_harms_nothing() -> None:
    async with FakeApiServer() as server, client_for(server.endpoint) as client:
        bench = Bench(text(), LastGood(client, "default", "none"))
        assert await bench.take(weights(TopologyScore=3)) is Outcome.SWAPPED


async def test_without_any_source_the_built_in_configuration_runs() -> None:
    running = await first(NoSource(), catalogue(), None)
    assert running.config == configuration.built_in(catalogue())
    assert not running.text


def test_flags_name_the_source_with_or_without_a_namespace() -> None:
    class Client:
        class endpoint:  # noqa: N801 - plays the client's attribute
            namespace = "mine"

    def of(*argv: str) -> list[str]:
        return [repr(part) for part in sources(Client(), parse(argv, {}))]  # type: ignore[arg-type]  # has what is read

    assert of() == ["built-in configuration", "None"]
    assert of("--config", "/c.yaml") == ["/c.yaml", "None"]
    assert of("--config-map", "a", "--last-good-config-map", "other/b") == ["ConfigMap mine/a", "ConfigMap other/b"]
