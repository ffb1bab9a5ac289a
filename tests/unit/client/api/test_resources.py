"""Paths of resources."""

import pytest

from robotapp_client.api.resources import DEPLOYMENTS, EVENTS, NODES, PODS, ROBOTAPPS, ROBOTCLAIMS, Resource


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        (PODS.path(), "/api/v1/pods"),
        (PODS.path("a"), "/api/v1/namespaces/a/pods"),
        (PODS.path("a", "b", "binding"), "/api/v1/namespaces/a/pods/b/binding"),
        (NODES.path(), "/api/v1/nodes"),
        (NODES.path(name="n"), "/api/v1/nodes/n"),
        (NODES.path("ignored", "n"), "/api/v1/nodes/n"),
        (DEPLOYMENTS.path("a", "b"), "/apis/apps/v1/namespaces/a/deployments/b"),
        (EVENTS.path("a"), "/apis/events.k8s.io/v1/namespaces/a/events"),
        (ROBOTAPPS.path("a", "b", "status"), "/apis/robotics.io/v1alpha1/namespaces/a/robotapps/b/status"),
        (ROBOTCLAIMS.path(name="dds.default.c.7"), "/apis/robotics.io/v1alpha1/robotclaims/dds.default.c.7"),
    ],
)
def test_paths_are_those_of_the_api_server(path: str, expected: str) -> None:
    assert path == expected


def test_an_object_of_a_namespaced_resource_needs_its_namespace() -> None:
    with pytest.raises(ValueError, match="needs a namespace"):
        PODS.path(name="b")


def test_an_empty_name_never_addresses_the_collection() -> None:
    with pytest.raises(ValueError, match="must not be empty"):
        NODES.path(name="")


def test_the_core_group_has_no_group_in_its_api_version() -> None:
    assert (PODS.api_version, DEPLOYMENTS.api_version) == ("v1", "apps/v1")
    assert Resource("", "v1", "secrets", "Secret", namespaced=True).path("x") == "/api/v1/namespaces/x/secrets"
