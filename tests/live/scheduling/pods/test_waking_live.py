"""What brings waiting pods back on a live control plane: odd sequences of changes after which nobody may wait for a timeout."""

import pytest

from campaigns.rigs.stage import Json, Stage, nodes, pod
from robotapp_testbed import ControlPlane
from robotapp_testbed.machines.nodes import edge

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("scheduler")]

KIND = {"kind-of": "its-own"}


def together(name: str) -> Json:
    """A pod that must be on a node with its kind, the first one anywhere."""
    term = {"topologyKey": "kubernetes.io/hostname", "labelSelector": {"matchLabels": KIND}}
    affinity = {"podAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": [term]}}
    return pod(name, labels=KIND, affinity=affinity)


def test_the_first_of_its_kind_goes_anywhere_as_soon_as_the_last_one_elsewhere_is_gone(
    installed_plane: ControlPlane, stage: Stage
) -> None:
    with nodes(installed_plane, edge("edge-1")):
        stage.create_pod(together("old"))
        assert stage.wait_bound("old") == "edge-1"
        installed_plane.api.patch("/api/v1/nodes/edge-1", {"spec": {"unschedulable": True}})
        with nodes(installed_plane, edge("edge-2")):
            stage.wait_known("edge-2")
            stage.create_pod(together("new"))
            stage.wait_refused("new", reason="Unschedulable")
            stage.delete_pod("old")
            assert stage.wait_bound("new") == "edge-2"
