"""A pod becomes a user of its resource claims on the way to its node, and no user any more when it is not bound there."""

import pytest
from tests.support.scheduler.devices import allocated_on, claim
from tests.support.scheduler.placing import Rig

from robotapp_api.model.names import PodReason
from robotapp_scheduler.core.api.core_v1 import ClaimReference
from robotapp_scheduler.core.framework.handle import BindOutcome, BindResult

CAMERA = (ClaimReference(name="camera", resource_claim_name="camera"),)


@pytest.fixture
def rig() -> Rig:
    rig = Rig()
    rig.core.cluster.resource_claims.apply_claim(claim("camera", allocated_on(), namespace="a"))
    return rig


async def test_a_pod_that_cannot_become_a_user_of_its_claims_goes_back_with_the_reason(rig: Rig) -> None:
    rig.claims.trouble = "claim default/camera got deleted in the meantime"
    rig.show("p", resource_claims=CAMERA)
    await rig.turn()
    assert rig.io.asked == []
    text = 'running PreBind plugin "DynamicResources": claim default/camera got deleted in the meantime'
    assert rig.said.lines == [(PodReason.SCHEDULER_ERROR, "p", text)]
    assert rig.claims.released == ["p"], "of several claims the first may have been written"
    rig.claims.trouble = ""
    rig.show("q", resource_claims=CAMERA)
    await rig.turn()
    assert (rig.claims.bound, [name for name, *_ in rig.io.asked]) == (["p", "q"], ["q"])
    assert rig.claims.released == ["p"]


async def test_a_pod_that_may_be_bound_stays_a_user_of_its_claims(rig: Rig) -> None:
    rig.io.binds.append(BindOutcome(BindResult.FAILED, "the reply got lost"))
    rig.show("p", resource_claims=CAMERA)
    await rig.turn()
    assert (rig.claims.bound, rig.claims.released) == (["p"], [])
