from tests.support.scheduling import make_cluster, make_node, make_pod, owner

from robotapp_scheduler.core.api.core_v1 import NodeImage
from robotapp_scheduler.core.pods.interning import Interner

REPLICA = owner("ReplicaSet", "rs", "u1")


def test_siblings_share_equal_parts_and_keep_what_is_their_own() -> None:
    alike = Interner()
    first, second, other = (
        make_pod(f"p{i}", node="n", labels={"app": app}, owner=REPLICA, cpu="1")
        for i, app in enumerate(("a", "a", "b"))
    )
    before = [repr(pod) for pod in (first, second, other)]
    for pod in (first, second, other):
        alike.share(pod)
    assert second.metadata.labels is first.metadata.labels
    assert second.spec.containers is first.spec.containers
    assert other.metadata.labels == {"app": "b"}
    assert other.spec.containers is first.spec.containers
    assert [repr(pod) for pod in (first, second, other)] == before


def test_pods_of_other_owners_and_namespaces_share_nothing() -> None:
    alike = Interner()
    pods = [make_pod("p", node="n", namespace=name) for name in ("a", "b")]
    for pod in pods:
        alike.share(pod)
    assert pods[0].spec.containers is not pods[1].spec.containers
    assert alike.same((1, 2)) == (1, 2)


def test_nodes_with_equal_images_hold_the_same_objects() -> None:
    nodes = [make_node(name) for name in ("a", "b", "c")]
    for node, names in zip(nodes, (("x",), ("x",), ("x", "y")), strict=True):
        node.status.images = tuple(NodeImage((name,), 1) for name in names)
    make_cluster(*nodes)
    assert nodes[1].status.images is nodes[0].status.images
    assert nodes[2].status.images[0] is nodes[0].status.images[0]


def test_replicas_in_the_same_state_hold_one_status_and_nodes_of_their_own() -> None:
    alike = Interner()
    first, second, third = (make_pod(f"p{i}", node=f"n{i}", owner=REPLICA, priority=i // 2) for i in range(3))
    for pod in (first, second, third):
        pod.status.phase = "Running"
        alike.share(pod)
    assert second.status is first.status
    assert [pod.spec.node_name for pod in (first, second, third)] == ["n0", "n1", "n2"]
    assert [pod.spec.priority for pod in (first, second, third)] == [0, 0, 1]
    assert third.spec.containers is first.spec.containers


def test_versions_of_a_pod_and_its_siblings_each_keep_their_node() -> None:
    alike = Interner()
    sibling, bound, running = (make_pod(name, node=node, owner=REPLICA) for name, node in ("am", "bn", "bn"))
    for pod in (bound, sibling, running, sibling):
        alike.share(pod)
    assert [pod.spec.node_name for pod in (sibling, bound, running)] == ["m", "n", "n"]
