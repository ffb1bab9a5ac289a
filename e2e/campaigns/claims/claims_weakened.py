"""Product functions replaced by weaker ones, for tests that must notice."""

import contextlib
import random
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import Any, Final
from unittest import mock

import msgspec

from robotapp_claims.protocol import sweep_snapshot
from robotapp_claims.protocol.sweep_snapshot import View
from robotapp_claims.protocol.writes import Api
from robotapp_claims.rules import device, release
from robotapp_claims.rules.bind import ALLOWED, BindVerdict, bind_verdict
from robotapp_claims.rules.device import PodUse, Take
from robotapp_claims.rules.objects import Claim, Pod
from robotapp_claims.rules.release import Preconditions, Release
from robotapp_client.transport.errors import Forbidden

Weakened = Callable[[], contextlib.AbstractContextManager[None]]


@contextlib.contextmanager
def _instead(**weak: Callable[..., Any]) -> Iterator[None]:
    """Functions by `module__name`, the module being one of robotapp_claims."""
    with contextlib.ExitStack() as stack:
        for target, function in weak.items():
            stack.enter_context(mock.patch("robotapp_claims." + target.replace("__", "."), function))
        yield


@contextlib.contextmanager
def no_bind_check() -> Iterator[None]:
    """The template is the lock."""

    def always(_: Pod, __: Claim | None, **___: Any) -> BindVerdict:
        return ALLOWED

    with _instead(protocol__bind_check__bind_verdict=always):
        yield


@contextlib.contextmanager
def bind_on_draining() -> Iterator[None]:
    """The bind check accepts a claim that is being released."""

    def weak(pod: Pod, claim: Claim | None, **more: Any) -> BindVerdict:
        if claim is not None and claim.draining:
            claim = msgspec.structs.replace(claim, status=msgspec.structs.replace(claim.status, phase="Reserved"))
        return bind_verdict(pod, claim, **more)

    with _instead(protocol__bind_check__bind_verdict=weak):
        yield


@contextlib.contextmanager
def uid_only() -> Iterator[None]:
    """Writes carry the claim's uid but not its version."""

    def weak(claim: Claim) -> Preconditions:
        return Preconditions(claim.metadata.uid, "")

    with _instead(protocol__writes__preconditions=weak):
        yield


@contextlib.contextmanager
def by_name() -> Iterator[None]:
    """Writes carry nothing but the name."""

    def weak(_: Claim) -> Preconditions:
        return Preconditions("", "")

    with _instead(protocol__writes__preconditions=weak):
        yield


@contextlib.contextmanager
def one_phase() -> Iterator[None]:
    """Unused is deleted at once."""

    def hasty(**facts: Any) -> Release:
        decision = release.release_domain(**facts)
        return Release.DELETE if decision is Release.DRAIN else decision

    with _instead(protocol__sweeper__release_domain=hasty):
        yield


@contextlib.contextmanager
def no_second_look() -> Iterator[None]:
    """After the quarantine the claim is deleted, whatever uses it by then."""

    def blind(*, phase: str, rested: bool, **facts: Any) -> Release:
        unused = {"wanted": False, "used": False} if phase == "Draining" else {}
        return release.release_domain(phase=phase, rested=rested, **{**facts, **unused})

    with _instead(protocol__sweeper__release_domain=blind):
        yield


@contextlib.contextmanager
def forbidden_is_gone() -> Iterator[None]:
    """A 403 is taken for a 404."""

    async def find(*what: Any) -> Any:
        try:
            return await found(*what)
        except Forbidden:
            return None

    found = sweep_snapshot.find
    with _instead(protocol__sweep_snapshot__find=find):
        yield


@contextlib.contextmanager
def create_without_list() -> Iterator[None]:
    """An instance's claims are not looked for before one is created."""

    async def nothing(*_: Any, **__: Any) -> list[Claim]:
        return []

    with _instead(protocol__domains__instance_claims=nothing):
        yield


@contextlib.contextmanager
def random_order() -> Iterator[None]:
    """Every process tries ids in an order of its own."""

    def shuffled(ids: Iterable[int], *_: str) -> tuple[int, ...]:
        found = sorted(set(ids))
        return tuple(random.sample(found, len(found)))

    with _instead(rules__domain__id_order=shuffled):
        yield


@contextlib.contextmanager
def pods_first() -> Iterator[None]:
    """The sweep lists the workloads before the claims."""

    async def weak(client: Api, namespaces: Collection[str] | None) -> View:
        usage, pods = await sweep_snapshot._workloads(client, namespaces)
        view = await read_view(client, namespaces)
        view.usage, view.pods = usage, {pod.metadata.uid: pod for pod in pods}
        return view

    read_view = sweep_snapshot.read_view
    with _instead(protocol__sweeper__read_view=weak):
        yield


@contextlib.contextmanager
def anyone_takes() -> Iterator[None]:
    """A device that another holder has may be taken over."""

    def weak(claim: Claim | None, **who: Any) -> Take:
        return Take.TAKE if device.take_device(claim, **who) is Take.BUSY else device.take_device(claim, **who)

    with (
        _instead(protocol__devices__take_device=weak, protocol__devices__same_tuple=_mine),
        mock.patch("robotapp_scheduler.core.robotics.device_index.take_device", weak),
    ):
        yield


@contextlib.contextmanager
def terminating_is_gone() -> Iterator[None]:
    """The device of a pod that terminates is free."""

    def weak(claim: Claim, pod: Pod | None) -> PodUse:
        return device.pod_use(claim, None if pod is not None and pod.metadata.deletion_timestamp else pod)

    async def nobody(*_: Any) -> bool:
        return False

    with _instead(protocol__sweeper__pod_use=weak, protocol__sweeper__used_on_node=nobody):
        yield


def _mine(*_: Any) -> None:
    return None


ALL: Final[Mapping[str, Weakened]] = {
    weak.__name__: weak
    for weak in (
        no_bind_check,
        bind_on_draining,
        uid_only,
        by_name,
        one_phase,
        no_second_look,
        forbidden_is_gone,
        create_without_list,
        random_order,
        pods_first,
        anyone_takes,
        terminating_is_gone,
    )
}
"""docs/claims.md says which of them the models find, and which the storm."""
ONE_SLEEPER: Final[Mapping[Weakened, str]] = {no_bind_check: "DOUBLE: ", uid_only: "without its claim"}
"""With the harm each does: those that one sleeping process is enough for. `one_phase` needs several, and
e2e/campaigns/claims/model finds all."""
FOUND_BY_MODELS: Final[Mapping[str, tuple[str, ...]]] = {
    "no_bind_check": ("U1", "U2", "U3"),
    "bind_on_draining": ("M10",),
    "uid_only": ("M7", "DM2"),
    "by_name": ("M8",),
    "one_phase": ("M5",),
    "no_second_look": ("M4",),
    "forbidden_is_gone": ("M6",),
    "create_without_list": ("M1",),
    "random_order": ("M2",),
    "pods_first": ("M9",),
    "anyone_takes": ("DM1",),
    "terminating_is_gone": ("DM5",),
}
"""Scenarios (e2e/campaigns/claims/model) in which the same rule is weakened, and caught: the table of docs/claims.md."""
