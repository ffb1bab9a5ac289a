"""A pod becomes a user of its resource claims on the way to its node."""

from tests.unit.shell.binding.test_binding_cycle import Rig

from robotapp_api.model.names import PodReason
from robotapp_scheduler.core.api.core_v1 import ClaimReference


async def test_a_pod_that_cannot_become_a_user_of_its_claims_goes_back_with_the_reason_and_another_is_entered_first() -> (
    None
):
    rig = Rig()
    rig.volumes.trouble = "resource claim 'camera' is being deleted"
    rig.show("p", resource_claims=(ClaimReference(name="camera", resource_claim_name="camera"),))
    await rig.turn()
    assert rig.io.asked == []
    text = "running PreBind plugin \"DynamicResources\": resource claim 'camera' is being deleted"
    assert rig.said.lines == [(PodReason.SCHEDULER_ERROR, "p", text)]
    rig.volumes.trouble = ""
    rig.show("q", resource_claims=(ClaimReference(name="camera", resource_claim_name="camera"),))
    await rig.turn()
    assert (rig.volumes.entered, [name for name, *_ in rig.io.asked]) == (["p", "q"], ["q"])
