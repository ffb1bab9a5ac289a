"""Caches the nodes where the driver runs, and the devices that ResourceClaims hold."""

from collections import Counter
from collections.abc import Callable

from robotapp_api.model.names import Label
from robotapp_claims.rules.device_attributes import list_held
from robotapp_claims.rules.objects import Claim, ResourceClaim, ResourceSlice
from robotapp_operator.plan.render.devices.ledger import DriverNodes
from robotapp_operator.plan.spec.objects import Pod
from robotapp_operator.watch.indexes.index import ClaimIndex, InstanceIndex
from robotapp_operator.watch.nodes import Nodes


class Allocations:
    """ResourceClaims of apps, devices that any ResourceClaim holds, and the nodes whose driver publishes devices."""

    def __init__(self, changed: Callable[[str, str], None]) -> None:
        self.claims: InstanceIndex[ResourceClaim] = InstanceIndex(lambda claim: claim.metadata.instance, changed)
        """ResourceClaims by the uid of the app that controls them."""
        self.held = ClaimIndex(changed)
        """Devices by the uid of their holder."""
        self._slices: dict[str, str] = {}
        self._nodes: Counter[str] = Counter()
        self.version = 0
        """Counts up when a node gains or loses the driver."""

    def __repr__(self) -> str:
        return f"<Allocations: {len(self._nodes)} nodes with the driver, {len(self.held.by_name)} devices held>"

    def driver_nodes(self, nodes: Nodes) -> DriverNodes:
        """Returns the nodes with the driver, and their labels."""
        names = frozenset(self._nodes)
        return DriverNodes(names, {name: node.metadata.labels for name in names if (node := nodes.get(name))})

    def put_slice(self, item: ResourceSlice) -> bool:
        """Returns whether the node is one more with the driver."""
        self.drop_slice(item)
        node = item.spec.node_name
        if not node:
            return False  # for several nodes: no driver of ours writes such a slice
        self._slices[item.metadata.name] = node
        self._nodes[node] += 1
        is_new = self._nodes[node] == 1
        self.version += is_new
        return is_new

    def drop_slice(self, item: ResourceSlice) -> None:
        """Forgets a slice; a node without one has no driver."""
        node = self._slices.pop(item.metadata.name, None)
        if node is None:
            return
        self._nodes[node] -= 1
        if not self._nodes[node]:
            del self._nodes[node]
            self.version += 1

    def put_claim(self, claim: ResourceClaim, *, before: ResourceClaim | None) -> None:
        """Keeps what the claim holds now; an app's claim is kept itself, too."""
        if before is not None:
            self.drop_claim(before)
        for held in list_held(claim):
            self.held.put(held.holder.uid, held.name, held)
        if uid := _app_of(claim):
            self.claims.put(uid, _key(claim), claim)

    def drop_claim(self, claim: ResourceClaim) -> None:
        for held in list_held(claim):
            self.held.drop(held.holder.uid, held.name)
        if uid := _app_of(claim):
            self.claims.drop(uid, _key(claim))

    def lacks_its_claim(self, pod: Pod) -> bool:
        """Returns whether the pod's component has a ResourceClaim that no scheduler has entered the pod in.

        The claim was deleted below a pod on a node and made anew: the kubelet refuses it to this pod for ever, and no scheduler looks at
        a pod that has a node.
        """
        meta = pod.metadata
        component = meta.labels.get(Label.COMPONENT, "")
        claims = [
            claim
            for claim in self.claims.of_instance(meta.app_uid, meta.instance).values()
            if claim.metadata.namespace == meta.namespace
            and claim.metadata.labels.get(Label.COMPONENT, "") == component
        ]
        return bool(pod.spec.node_name and claims) and not any(
            user.uid == meta.uid for claim in claims for user in claim.status.reserved_for
        )

    def held_by(self, uid: str, instance: str, *, namespace: str) -> list[Claim]:
        """Returns devices of one instance. Anybody may name another tenant's app as owner, but in a namespace of his own alone."""
        held = self.held.of_instance(uid, instance).values()
        return [claim for claim in held if claim.holder.namespace == namespace]


def _key(claim: ResourceClaim) -> str:
    return f"{claim.metadata.namespace}/{claim.metadata.name}"


def _app_of(claim: ResourceClaim) -> str:
    owner = claim.metadata.controller
    return owner.uid if owner is not None and owner.is_app else ""
