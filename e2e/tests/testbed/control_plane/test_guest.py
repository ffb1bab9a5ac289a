"""What a guest in a user's cluster does to the applications it shows."""

from pathlib import Path

import pytest

from journeys.demo_cluster import confine
from robotapp_testbed import TestbedError
from robotapp_testbed.control_plane.guest import GUEST_LABEL, TAINT, GuestPlane, OwnKubectl


def test_every_component_is_kept_on_the_simulated_nodes() -> None:
    mine = {"key": "gpu", "operator": "Exists"}
    template = {"metadata": {"labels": {"a": "b"}}, "spec": {"tolerations": [mine], "nodeSelector": {"x": "y"}}}
    app = {"spec": {"components": [{"name": "a", "template": template}, {"name": "b"}]}}
    first, second = (component["template"] for component in confine(app)["spec"]["components"])
    toleration = {"key": TAINT["key"], "operator": "Exists"}
    assert first["metadata"] == template["metadata"]
    assert first["spec"]["tolerations"] == [mine, toleration]
    assert first["spec"]["nodeSelector"] == {"x": "y", GUEST_LABEL: "true"}
    assert second["spec"]["tolerations"] == [toleration]
    assert app["spec"]["components"][1] == {"name": "b"}


def test_a_missing_kubeconfig_is_named(tmp_path: Path) -> None:
    with pytest.raises(TestbedError, match="there is no kubeconfig"):
        OwnKubectl(tmp_path / "absent")


def test_a_guest_needs_no_control_plane_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "kubeconfig").touch()
    guest = GuestPlane(tmp_path / "kubeconfig", nodes=[], namespaces=[])
    assert guest.binary_names == ["kwok", "kubectl", "helm"]
