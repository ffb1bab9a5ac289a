"""A pod becomes a user of its resource claims before it is bound, each entry once, beside those of others."""

from typing import Any

import msgspec
import pytest
from tests.support.scheduling import make_info
from tests.support.scripted import ScriptedClient

from robotapp_client.transport.errors import Conflict, NotFound
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.core.pods.resource_claims import ResourceClaim
from robotapp_scheduler.shell.binding.resource_claim_users import TRIES, ClaimUsers

OTHER = {"resource": "pods", "name": "other", "uid": "uid-other"}
SELF = {"resource": "pods", "name": "p", "uid": "uid-p"}


def claim(*users: dict[str, str], allocated: bool = True, version: str = "5", **meta: Any) -> ResourceClaim:
    status = {"allocation": {} if allocated else None, "reservedFor": list(users)}
    metadata = {"name": "camera", "namespace": "default", "uid": "u", "resourceVersion": version, **meta}
    return msgspec.convert({"metadata": metadata, "status": status}, ResourceClaim)


def wanting(*claims: dict[str, str]) -> PodInfo:
    return make_info("p", resourceClaims=list(claims or [{"name": "camera", "resourceClaimName": "camera"}]))


async def entered(client: ScriptedClient, pod: PodInfo | None = None) -> str:
    return await ClaimUsers(client).enter(pod or wanting())


async def test_the_pod_is_added_to_the_users_of_the_version_that_was_read() -> None:
    client = ScriptedClient().script("get", claim(OTHER)).script("patch", {})
    assert await entered(client) == ""
    _, (method, path, (_, patch)) = client.calls
    assert (method, path.endswith("/resourceclaims/camera/status")) == ("patch", True)
    assert patch == {"metadata": {"uid": "u", "resourceVersion": "5"}, "status": {"reservedFor": [OTHER, SELF]}}


async def test_a_pod_that_is_a_user_already_writes_nothing() -> None:
    client = ScriptedClient().script("get", claim(OTHER, SELF))
    assert await entered(client) == ""
    assert client.methods() == ["get"]


async def test_somebody_else_entering_meanwhile_is_kept() -> None:
    client = ScriptedClient().script("get", claim(), claim(OTHER, version="6"))
    client.script("patch", Conflict("changed", status=409), {})
    assert await entered(client) == ""
    assert client.calls[-1][2][1]["status"]["reservedFor"] == [OTHER, SELF]


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (claim(allocated=False), "resource claim 'camera' is not allocated; this scheduler does not allocate devices"),
        (claim(deletionTimestamp="2026-01-01T00:00:00Z"), "resource claim 'camera' is being deleted"),
        (claim(*({**OTHER, "uid": f"u{i}"} for i in range(256))), "resource claim 'camera' is shared by 256 pods already"),
        (NotFound("gone", status=404), "resource claim 'camera': gone"),
    ],
)  # fmt: skip
async def test_what_changed_since_the_decision_is_told_and_nothing_is_written(found: Any, text: str) -> None:
    client = ScriptedClient().script("get", found)
    assert await entered(client) == text
    assert client.methods() == ["get"]


async def test_a_claim_that_never_stands_still_sends_the_pod_back() -> None:
    client = ScriptedClient().always("get", claim()).always("patch", Conflict("changed", status=409))
    assert "changes faster" in await entered(client)
    assert client.methods().count("patch") == TRIES


async def test_without_claims_nothing_is_asked() -> None:
    client = ScriptedClient()
    assert await entered(client, make_info("p")) == ""
    assert client.calls == []
