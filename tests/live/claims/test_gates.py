"""Rule 6 on the real API server: the gate of a pod for another scheduler opens on its own instance's standing claim alone."""

import msgspec
import pytest

from campaigns.rigs.claims_live import Json, Live
from robotapp_api.model.names import SCHEDULING_GATE
from robotapp_claims.protocol.domains import ensure_domain, find_claim
from robotapp_claims.protocol.writes import drain, touch
from robotapp_claims.rules.domain import DomainOutcome, DomainRequest
from robotapp_claims.rules.objects import Claim
from robotapp_client.api.resources import PODS, ROBOTCLAIMS
from robotapp_operator.plan.spec.objects import Pod
from robotapp_operator.reconcile.reconcile_state import ReconcileState
from robotapp_operator.reconcile.scheduling_gates import Gates
from robotapp_operator.watch.cache import Cache

pytestmark = pytest.mark.live
OTHERS = "somebody.example/else"


class Gated:
    """A pod with our gate and somebody else's, in the operator's cache as its watch shows it."""

    def __init__(self, place: Live, request: DomainRequest) -> None:
        self.place = place
        self.uid = request.holder.uid
        self.request = request
        self.cache = Cache()
        self.gates = Gates(place.operator, self.cache, ReconcileState())

    async def create(self, number: int, *, claim: str) -> None:
        gates = [{"name": SCHEDULING_GATE}, {"name": OTHERS}]
        made = await self.place.make_pod("gated", self.request.holder, number, claim=claim, gates=gates)
        self.cache.pods.put(self.uid, "gated", msgspec.convert(made, Pod))

    async def open(self) -> tuple[bool, list[str]]:
        """What the operator's attempt returns, and the gates the pod has afterwards."""
        done = await self.gates.open(self.uid, self.request.holder.instance)
        pod: Json = await self.place.admin.get(PODS, "gated", namespace=self.place.namespace)
        return done, [gate["name"] for gate in pod["spec"].get("schedulingGates", ())]


async def standing(place: Live, outcome: DomainOutcome) -> Claim:
    claim = await find_claim(place.admin, outcome.claim)
    assert claim is not None
    return claim


async def test_the_gate_stays_while_the_claim_drains_and_opens_when_it_is_taken_back(place: Live) -> None:
    request = await place.make_app()
    outcome = await ensure_domain(place.operator, request)
    gated = Gated(place, request)
    await gated.create(outcome.id or 0, claim=outcome.claim)
    draining = await drain(place.operator, await standing(place, outcome))
    assert await gated.open() == (False, [SCHEDULING_GATE, OTHERS])
    await touch(place.operator, draining)
    assert await gated.open() == (True, [OTHERS])


async def test_the_gate_stays_while_the_id_is_somebody_elses_or_nobodys(place: Live) -> None:
    request, stranger = await place.make_app(), await place.make_app("stranger")
    theirs = await ensure_domain(place.operator, stranger)
    gated = Gated(place, request)
    await gated.create(theirs.id or 0, claim=theirs.claim)
    assert await gated.open() == (False, [SCHEDULING_GATE, OTHERS])
    await place.admin.delete(ROBOTCLAIMS, theirs.claim)
    assert await gated.open() == (False, [SCHEDULING_GATE, OTHERS])
    mine = await ensure_domain(place.operator, DomainRequest(request.holder, pool=place.pool, requested_id=theirs.id))
    assert mine.held
    assert await gated.open() == (True, [OTHERS])


async def test_the_gate_of_a_sharer_follows_its_owners_claim(place: Live) -> None:
    owner = await place.make_app("mapper")
    outcome = await ensure_domain(place.operator, owner)
    gated = Gated(place, await place.make_app(ros2={"shareWith": [{"name": "mapper"}]}))
    await gated.create(outcome.id or 0, claim=outcome.claim)
    draining = await drain(place.operator, await standing(place, outcome))
    assert await gated.open() == (False, [SCHEDULING_GATE, OTHERS])
    await touch(place.operator, draining)
    assert await gated.open() == (True, [OTHERS])
