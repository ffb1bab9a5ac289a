"""What a user is told to ask for, by the API server's own sentence."""

import pytest

from robotapp_cli.failures import explained
from robotapp_client.transport.errors import Forbidden, NotFound

TENANT = 'is forbidden: User "tenant" cannot'
EVERYWHERE, IN_ONE = "at the cluster scope", 'in the namespace "fleet"'


@pytest.mark.parametrize(
    ("denied", "cure"),
    [
        (
            f'{TENANT} list resource "robotapps" in API group "robotics.io" {IN_ONE}',
            "a RoleBinding of ClusterRole view",
        ),
        (
            f'{TENANT} patch resource "robotapps" in API group "robotics.io" {IN_ONE}',
            "a RoleBinding of ClusterRole edit",
        ),
        (f'{TENANT} list resource "robotapps" in API group "robotics.io" {EVERYWHERE}', "a ClusterRoleBinding of view"),
        (
            f'{TENANT} list resource "nodes" in API group "" {EVERYWHERE}',
            "a ClusterRoleBinding of robotapp-cluster-viewer",
        ),
        ("an authorizer of another kind refuses", "ClusterRole view in the namespace, or robotapp-cluster-viewer"),
    ],
)
def test_the_binding_that_would_help_is_named(denied: str, cure: str) -> None:
    text = str(explained(Forbidden(denied, status=403)))
    assert text.startswith(f"you may not do this: {denied}\nAsk for {cure}")


def test_a_cluster_without_our_kinds_leads_to_the_installation() -> None:
    text = str(explained(NotFound("the server could not find the requested resource", status=404)))
    assert text.endswith("RobotApp is not installed in this cluster: docs/installation.md has the steps.")
