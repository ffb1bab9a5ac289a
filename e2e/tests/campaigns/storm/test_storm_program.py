"""The programs of a storm lose answers to writes that were done."""

from collections.abc import Iterator

import pytest
from tests.support.apiserver import FakeApiServer
from tests.support.clients import client_for

from campaigns.claims.claims_weakened import ALL
from campaigns.storm.program import Loser, command
from robotapp_client.api.resources import PODS
from robotapp_client.transport.errors import Unreachable
from robotapp_client.transport.http_transport import HttpTransport


@pytest.fixture
def transport() -> Iterator[None]:
    """The transport as it was before a loser was installed."""
    request, post = HttpTransport.request, HttpTransport.post
    yield
    HttpTransport.request, HttpTransport.post = request, post  # type: ignore[method-assign]


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
