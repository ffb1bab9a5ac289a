"""Product functions replaced by weaker ones, for tests that must notice."""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final
from unittest import mock

from robotapp_api.claims import release
from robotapp_api.claims.bind import ALLOWED, BindVerdict
from robotapp_api.claims.objects import Claim, Pod
from robotapp_api.claims.release import Preconditions, Release

Weakened = Callable[[], contextlib.AbstractContextManager[None]]


@contextlib.contextmanager
def no_bind_check() -> Iterator[None]:
    def always(_: Pod, __: Claim | None, **___: Any) -> BindVerdict:
        return ALLOWED

    with mock.patch("robotapp_api.client.bind_check.bind_verdict", always):
        yield


@contextlib.contextmanager
def uid_only() -> Iterator[None]:
    def weak(claim: Claim) -> Preconditions:
        return Preconditions(claim.metadata.uid, "")

    with mock.patch("robotapp_api.client.claim_writes.preconditions", weak):
        yield


@contextlib.contextmanager
def one_phase() -> Iterator[None]:
    def hasty(**facts: Any) -> Release:
        decision = release.release_domain(**facts)
        return Release.DELETE if decision is Release.DRAIN else decision

    with mock.patch("robotapp_api.client.sweep.release_domain", hasty):
        yield


ONE_SLEEPER: Final[Mapping[Weakened, str]] = {no_bind_check: "DOUBLE: ", uid_only: "without its claim"}
"""With the harm each does: those that one sleeping process is enough for. `one_phase` needs several, and
tests/support/claims_model finds all."""
