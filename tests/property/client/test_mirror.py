"""A mirror equals the server in the end, whatever happened on the way, and tells every difference exactly once."""

import asyncio
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.support.apiserver import FakeApiServer, Key
from tests.support.clients import client_for, configmap, until
from tests.support.seeds import count_examples

from robotapp_client import Change, Reflector
from robotapp_client.api.backoff import Backoff
from robotapp_client.api.resources import CONFIGMAPS

NAMES = ("a", "b", "c", "d")
FAULTS = {
    "compact": lambda api: api.store.compact(),
    "end": lambda api: api.end_watches(),
    "cut": lambda api: api.break_watches(),
    "garble": lambda api: api.garble_watches(),
    "error": lambda api: api.fail_watches(500),
    "gone": lambda api: api.fail_watches(410),
    "410 next": lambda api: api.failing.append(410),
    "503 next": lambda api: api.failing.append(503),
    "429 next": lambda api: api.failing.append(429),
    "cut next": lambda api: api.failing.append(0),
}


class Meta(msgspec.Struct, rename="camel"):
    name: str
    namespace: str
    uid: str
    resource_version: str


class Slim(msgspec.Struct):
    metadata: Meta
    data: dict[str, str] | None = None


changes = st.tuples(st.sampled_from(["put", "delete", "recreate"]), st.sampled_from(NAMES))
faults = st.tuples(st.sampled_from(sorted(FAULTS)), st.just(""))
pauses = st.tuples(st.just("pause"), st.just(""))
stories = st.lists(st.one_of(changes, changes, changes, faults, pauses), max_size=40)


def act(api: FakeApiServer, number: int, verb: str, name: str) -> None:
    key = Key("/configmaps", "default", name)
    obj = configmap(name, labels={"keep": "yes" if number % 3 else "no"}, value=str(number))
    if verb in ("delete", "recreate") and key in api.store.objects:
        api.store.delete(key, {})
    if verb in ("put", "recreate"):
        if key in api.store.objects:
            api.store.update(key, obj)
        else:
            api.store.create(key, obj)
    if verb in FAULTS:
        FAULTS[verb](api)


class Replay:
    """Applies reported changes to an empty dict and refuses any that does not follow from the one before."""

    def __init__(self) -> None:
        self.state: dict[str, Any] = {}
        self.complaints: list[str] = []

    def __call__(self, change: Change) -> None:
        known = self.state.get(change.key)
        if known is not change.old or (change.kind == "ADDED") != (change.old is None):
            self.complaints.append(f"{change.kind} {change.key} does not follow")
        if (change.kind == "DELETED") != (change.new is None):
            self.complaints.append(f"{change.kind} {change.key} has the wrong end")
        if known is not None and change.new is not None and known.metadata.uid != change.new.metadata.uid:
            self.complaints.append(f"{change.key} was reborn without a DELETED")
        if change.new is None:
            self.state.pop(change.key, None)
        else:
            self.state[change.key] = change.new


@pytest.mark.parametrize("streaming", [False, True], ids=["list+watch", "streaming list"])
@pytest.mark.parametrize("selector", ["", "keep=yes"])
@settings(max_examples=count_examples(60), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(story=stories, early=st.booleans())
def test_the_mirror_equals_the_server_after_any_story(
    story: list[tuple[str, str]], early: bool, streaming: bool, selector: str
) -> None:
    async def play() -> None:
        async with FakeApiServer(bookmark_s=0.02) as api, client_for(api.endpoint) as client:
            replay = Replay()
            reflector = Reflector(
                client,
                CONFIGMAPS,
                as_type=Slim,
                on_change=replay,
                label_selector=selector,
                streaming=streaming,
                page=2,
                backoff=Backoff(base_s=0.001, cap_s=0.004),
            )
            task = asyncio.create_task(reflector.run())
            if not early:
                await until(lambda: api.watching)
            for number, (verb, name) in enumerate(story):
                if verb == "pause":
                    await asyncio.sleep(0.004)
                else:
                    act(api, number, verb, name)
            api.failing.clear()

            def truth() -> dict[str, str]:
                return {
                    f"{key.namespace}/{key.name}": obj["metadata"]["resourceVersion"]
                    for key, obj in api.store.objects.items()
                    if not selector or obj["metadata"]["labels"]["keep"] == "yes"
                }

            def mirrored() -> dict[str, str]:
                return {key: obj.metadata.resource_version for key, obj in reflector.store.items()}

            await until(lambda: reflector.synced.is_set() and mirrored() == truth(), what="mirror = server")
            assert replay.complaints == []
            assert replay.state == dict(reflector.store)
            assert reflector.stats.callback_failures == 0
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    asyncio.run(play())


@pytest.mark.parametrize("streaming", [False, True], ids=["list+watch", "streaming list"])
@settings(max_examples=count_examples(40), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    before=st.lists(changes, max_size=8),
    lost=st.lists(changes, min_size=1, max_size=8),
    after=st.lists(changes),
    bump=st.sampled_from([0, 10**9]),
)
def test_a_mirror_equals_a_server_that_went_back_to_an_older_state(
    before: list[tuple[str, str]], lost: list[tuple[str, str]], after: list[tuple[str, str]], bump: int, streaming: bool
) -> None:
    """What was made since is dropped, what was deleted since is back, and content decides where versions are equal."""

    async def pause(seconds: float) -> None:
        await asyncio.sleep(seconds / 100)

    async def play() -> None:
        async with FakeApiServer(bookmark_s=0.02) as api, client_for(api.endpoint, sleep=pause) as client:
            replay = Replay()
            backoff = Backoff(base_s=0.001, cap_s=0.004)
            restored: list[None] = []
            reflector = Reflector(
                client,
                CONFIGMAPS,
                as_type=Slim,
                on_change=replay,
                streaming=streaming,
                backoff=backoff,
                on_restored=lambda: restored.append(None),
            )

            def content() -> dict[str, Any]:
                return {f"{key.namespace}/{key.name}": obj.get("data") for key, obj in api.store.objects.items()}

            def mirrored() -> dict[str, Any]:
                return {key: obj.data for key, obj in reflector.store.items()}

            for number, (verb, name) in enumerate(before):
                act(api, number, verb, name)
            snapshot = api.store.snapshot()
            task = asyncio.create_task(reflector.run())
            await until(lambda: api.watching)
            for number, (verb, name) in enumerate(lost):
                act(api, 100 + number, verb, name)
            api.store.create(Key("/configmaps", "default", "last"), configmap("last"))
            await until(lambda: mirrored() == content(), what="all that will be lost was seen")
            api.store.restore(snapshot, bump=bump)
            api.break_watches()
            await until(lambda: mirrored() == content() and api.watching > 0, what="the older state")
            for number, (verb, name) in enumerate(after):
                act(api, 200 + number, verb, name)
            await until(lambda: mirrored() == content(), what="the new history")
            assert (reflector.stats.restores, len(restored)) == (1, 1)
            assert replay.complaints == []
            assert replay.state == dict(reflector.store)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    asyncio.run(play())


def test_the_story_teller_reaches_every_fault() -> None:
    """The faults above do strike: otherwise the property would prove nothing."""

    async def play() -> None:
        async with FakeApiServer() as api, client_for(api.endpoint) as client:
            reflector = Reflector(client, CONFIGMAPS, as_type=dict, backoff=Backoff(base_s=0.001, cap_s=0.004))
            task = asyncio.create_task(reflector.run())
            await reflector.synced.wait()
            await until(lambda: api.watching)
            for fault in ("end", "cut", "garble", "error", "gone"):
                before = reflector.stats.watches
                FAULTS[fault](api)
                await until(lambda before=before: reflector.stats.watches > before and api.watching, what=fault)
            assert reflector.stats.gone == 1
            assert reflector.stats.failures == 3
            api.store.create(Key("/configmaps", "default", "x"), configmap("x"))
            await until(lambda: "default/x" in reflector.store)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    asyncio.run(play())
