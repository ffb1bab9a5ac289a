"""Our product on the testbed: its identities have the rights of the chart, and what they lack is noticed."""

from datetime import UTC, datetime

import pytest

from campaigns.rigs.quiet import refused_since
from robotapp_testbed import ControlPlane, wait_until

pytestmark = pytest.mark.live


@pytest.mark.parametrize(
    ("identity", "verb", "resource", "answer"),
    [
        ("operator", "create", "deployments.apps", "yes"),
        ("operator", "create", "pods/binding", "no"),
        ("scheduler", "create", "pods/binding", "yes"),
        ("tenant", "create", "robotapps.robotics.io", "no"),
    ],
)
def test_identities_have_the_rights_of_the_chart(
    identity: str, verb: str, resource: str, answer: str, installed_plane: ControlPlane
) -> None:
    asked = ["auth", "can-i", verb, *resource.split("/")[:1], "--all-namespaces"]
    asked += [f"--subresource={part}" for part in resource.split("/")[1:]]
    assert installed_plane.kubectl(*asked, identity=identity, check=False).splitlines()[-1] == answer


def test_what_a_component_has_no_right_to_is_noticed(installed_plane: ControlPlane) -> None:
    began = datetime.now(UTC)
    installed_plane.kubectl("get", "secrets", "-n", "kube-system", identity="scheduler", check=False)
    installed_plane.kubectl("get", "nodes", identity="scheduler")
    wanted = {"robotapp-scheduler list /api/v1/namespaces/kube-system/secrets"}
    assert wait_until(lambda: refused_since(installed_plane, began) == wanted, timeout_s=60.0, poll_s=0.2)
