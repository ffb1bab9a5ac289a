"""DDS domains of pods without a RobotApp: granted in the Binding, one holder each, free again after the rest."""

import pytest

from campaigns.rigs.stage import CLAIMS, Json, Stage, nodes, pod
from robotapp_api.model.names import API_VERSION, Annotation
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import edge

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("scheduler", "short_rest")]
POOL = f"/apis/{API_VERSION}/domainpools/default"


def wants(name: str, domain: str) -> Json:
    return pod(name, annotations={str(Annotation.DDS_DOMAIN): domain})


def granted(stage: Stage, name: str) -> str:
    stage.wait_bound(name)
    return str(stage.pod(name)["metadata"]["annotations"][str(Annotation.GRANTED_DOMAIN)])


def test_pods_that_ask_for_any_domain_get_different_ones_and_a_claim_each(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        names = [f"talker-{number}" for number in range(5)]
        for name in names:
            stage.create_pod(wants(name, "auto"))
        domains = {granted(stage, name) for name in names}
        assert len(domains) == 5
        holders = {
            claim["spec"]["holder"]["uid"]
            for claim in installed_plane.api.get(CLAIMS)["items"]
            if str(claim["spec"].get("domain", {}).get("id")) in domains
        }
        assert holders == {stage.pod(name)["metadata"]["uid"] for name in names}


@pytest.mark.parametrize("number", ["0", "102", "150", "214"])
def test_a_bare_pod_gets_no_unsafe_id_by_asking_for_it(
    installed_plane: ControlPlane, stage: Stage, number: str
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(wants("unsafe", number))
        message = stage.wait_refused("unsafe", reason="InvalidAnnotation")
        assert '"auto" or a number of 1-101,215-232' in message


def test_a_bare_pod_gets_no_reserved_id_by_asking_for_it(installed_plane: ControlPlane, stage: Stage) -> None:
    reserved = installed_plane.api.get(POOL)["spec"].get("reserved")
    with nodes(installed_plane, edge("edge-1")):
        installed_plane.api.patch(POOL, {"spec": {"reserved": [0, 66]}})
        try:
            stage.create_pod(wants("greedy", "66"))
            message = stage.wait_refused("greedy", reason="InvalidAnnotation")
            assert "domain 66 is reserved in pool default" in message
            assert 'write "auto"' in message
        finally:
            installed_plane.api.patch(POOL, {"spec": {"reserved": reserved}})


def test_a_pod_whose_variable_reads_a_wrong_annotation_is_refused_with_the_line_to_write(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    path = "metadata.annotations['scheduler.robotics.io/domain']"
    lost = wants("lost", "auto")
    lost["spec"]["containers"][0]["env"] = [{"name": "ROS_DOMAIN_ID", "valueFrom": {"fieldRef": {"fieldPath": path}}}]
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(lost)
        message = stage.wait_refused("lost", reason="InvalidAnnotation")
        assert f"metadata.annotations['{Annotation.GRANTED_DOMAIN}']" in message


def test_the_second_pod_of_a_number_waits_is_told_who_has_it_and_gets_it_after_the_rest(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(wants("first", "77"))
        assert granted(stage, "first") == "77"
        stage.create_pod(wants("second", "77"))
        message = stage.wait_refused("second", reason="WaitingForDomain")
        assert f"{stage.namespace}/first" in message
        stage.delete_pod("first")
        assert granted(stage, "second") == "77"
