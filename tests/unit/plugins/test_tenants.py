"""Robots choose their tenants."""

import numpy as np
from tests.support.scheduling import make_cluster, make_info, make_node

from robotapp_api.model.names import Annotation, Label
from robotapp_scheduler.core.api.ros import RosContext
from robotapp_scheduler.core.cache.snapshot import Snapshot
from robotapp_scheduler.core.pods.pod_info import PodInfo
from robotapp_scheduler.plugins.ros.tenants import AllowedNamespaces


def pod(tenant: str) -> PodInfo:
    info = make_info("p")
    info.ros = RosContext(tenant=tenant)
    return info


def test_a_robot_takes_only_the_namespaces_it_admits_on_all_of_its_computers() -> None:
    owned = {str(Label.ROBOT): "amr-07"}
    theirs = {str(Annotation.ALLOWED_NAMESPACES): "fleet"}
    cluster = make_cluster(
        make_node("head", labels=owned, annotations=theirs), make_node("arm", labels=owned), make_node("edge")
    )
    plugin, nodes = AllowedNamespaces(), Snapshot(cluster)
    passes = plugin.filter(pod("guest"), nodes)
    assert np.flatnonzero(np.asarray(passes)).tolist() == [cluster.nodes.row_of["edge"]]
    assert np.asarray(plugin.filter(pod("guest"), Snapshot(cluster, [1]))).tolist() == [False]
    assert plugin.filter(pod("fleet"), nodes) is True
    assert plugin.filter(make_info("p"), nodes) is None
    assert not any(name in plugin.reason for name in ("amr-07", "fleet"))
