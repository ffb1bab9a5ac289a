"""A recording is a component: placed and made as the others, and changed without them."""

import pytest

from campaigns.rigs.live import Tenant, eventually, part
from robotapp_testbed.failures import ApiStatusError

pytestmark = pytest.mark.usefixtures("operator")

ALL = {"name": "all", "topics": {"regex": ".*"}, "retain": {"size": "1Gi"}}


def generations(tenant: Tenant) -> dict[str, int]:
    """The generation of each component's Deployment."""
    return {
        each["metadata"]["labels"]["robotics.io/component"]: each["metadata"]["generation"]
        for each in tenant.deployments()
        if "robotics.io/component" in each["metadata"]["labels"]
    }


def test_an_app_with_a_recording_is_ready_and_a_change_of_it_rolls_the_recorder_alone(tenant: Tenant, ids: str) -> None:
    tenant.apply("recorded", part("a"), part("b"), ros2={"pool": ids}, recordings=[ALL])
    app = tenant.wait_ready("recorded")
    assert app["status"]["summary"]["ready"] == "3/3"
    before = generations(tenant)
    assert set(before) == {"a", "b", "all"}
    tenant.edit("recorded", recordings=[ALL | {"retain": {"size": "2Gi"}}])
    eventually(lambda: generations(tenant)["all"] > before["all"])
    tenant.wait_ready("recorded")
    assert generations(tenant) == before | {"all": generations(tenant)["all"]}
    tenant.edit("recorded", recordings=None)
    eventually(lambda: set(generations(tenant)) == {"a", "b"})


def test_a_recording_that_cannot_be_is_not_accepted_with_its_cure(tenant: Tenant, ids: str) -> None:
    wrong = ALL | {"topics": {"regex": "("}}
    tenant.apply("wrong", part("a"), ros2={"pool": ids}, recordings=[wrong])
    eventually(lambda: "is no regular expression" in tenant.condition("wrong", "Accepted")["message"])
    assert tenant.condition("wrong", "Accepted")["status"] == "False"


def test_a_recording_with_the_name_of_a_component_is_refused(tenant: Tenant) -> None:
    with pytest.raises(ApiStatusError, match="recordings have names of components"):
        tenant.apply("same", part("all"), recordings=[ALL])
