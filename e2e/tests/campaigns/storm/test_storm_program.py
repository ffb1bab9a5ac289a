"""The programs of a storm lose answers to writes alone, the same ones with the same seed, and do not know that it is on purpose."""

from collections.abc import Iterator

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for

from campaigns.claims.claims_weakened import ALL
from campaigns.storm.program import Loser, command
from robotapp_client.api.resources import PODS
from robotapp_client.transport.errors import Unreachable
from robotapp_client.transport.http_transport import HttpTransport

CLAIM = "/apis/robotics.io/v1alpha1/robotclaims/dds.default.c.7/status"


@pytest.fixture
def transport() -> Iterator[None]:
    """The transport as it was before a loser was installed."""
    request, post = HttpTransport.request, HttpTransport.post
    yield
    HttpTransport.request, HttpTransport.post = request, post  # type: ignore[method-assign]


def test_reads_events_and_leases_are_answered_always() -> None:
    loser = Loser(1.0, seed=1)
    assert loser.loses("PUT", CLAIM)
    for method, path in (
        ("GET", CLAIM),
        ("POST", "/apis/events.k8s.io/v1/namespaces/a/events?x=1"),
        ("PUT", "/apis/coordination.k8s.io/v1/namespaces/a/leases/b"),
    ):
        assert loser.loses(method, path) is None


def test_the_seed_decides_which_answers_are_lost() -> None:
    lost = [[bool(loser.loses("PUT", CLAIM)) for _ in range(200)] for loser in (Loser(0.1, 7), Loser(0.1, 7))]
    assert lost[0] == lost[1]
    assert 5 < sum(lost[0]) < 50


@pytest.mark.usefixtures("transport")
async def test_what_is_lost_is_the_answer_and_not_the_write() -> None:
    async with FakeApiServer() as server, client_for(server.endpoint) as client:
        Loser(1.0, seed=1).install()
        pod = {"metadata": {"name": "p", "namespace": "a"}, "spec": {"containers": [{"name": "c", "image": "i"}]}}
        with pytest.raises(Unreachable) as error:
            await client.create(PODS, pod)
        assert error.value.maybe_applied
        assert (await client.get(PODS, "p", namespace="a"))["metadata"]["name"] == "p"


def test_the_twelve_weaker_rules_can_be_put_in_place_and_taken_out_again() -> None:
    assert len(ALL) == 12
    for weak in ALL.values():
        with weak():
            pass
    assert command(weakened="one_phase")[-1] == "--weakened=one_phase"
