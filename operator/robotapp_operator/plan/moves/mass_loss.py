"""Whether so many devices were lost at once that a mistake is likelier: an agent that reads nothing, a bad release of it.

The rule is that of robots without a node (`claims.instances`): more than three and more than a tenth, or all of several. It is
applied to the pods of one node and to the nodes of the cluster, so that one agent cannot hold back what happens on other nodes.
All are levels: an operator that restarts decides the same.
"""

import dataclasses
from collections.abc import Iterable, Mapping

from robotapp_claims.rules.instances import are_many, too_many_missing
from robotapp_claims.rules.objects import Claim

Pods = frozenset[str]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Losses:
    """By node, the uids of pods that hold devices of it, and of those that have lost one.

    lost: only nodes with a loss.
    """

    holding: Mapping[str, Pods]
    lost: Mapping[str, Pods]

    def why_no_move(self, node: str) -> str:
        """Why no pod is moved off this node for a device, "" when it may be."""
        here = self.holding.get(node, frozenset())
        if too_many_missing(here, here - self.lost.get(node, frozenset())):
            where = "pods on its node"
        elif too_many_missing(self.holding.keys(), self.holding.keys() - self.lost.keys()):
            where = "nodes"
        else:
            return ""
        return f"so many {where} lost devices at once that a mistake of the agent is likelier; delete the pod to have it moved"

    def too_many_to_restart(self, node: str) -> bool:
        """Whether losses on this node are not recorded, so that nothing there restarts when the devices are back.

        All of two or three pods of a node may restart: behind one USB hub devices do vanish together.
        """
        here, gone = self.holding.get(node, ()), self.lost.get(node, ())
        return are_many(len(gone), len(here)) or are_many(len(self.lost), len(self.holding))


def losses_of(claims: Iterable[tuple[Claim, bool]]) -> Losses:
    """claims: of devices, each with whether the device is lost."""
    holding: dict[str, set[str]] = {}
    lost: dict[str, set[str]] = {}
    for claim, is_lost in claims:
        thing, pod = claim.spec.device, claim.status.pod
        if thing is None or claim.draining or not pod:
            continue
        holding.setdefault(thing.node, set()).add(pod)
        if is_lost:
            lost.setdefault(thing.node, set()).add(pod)
    return Losses(holding=_frozen(holding), lost=_frozen(lost))


def _frozen(pods: Mapping[str, set[str]]) -> dict[str, Pods]:
    return {node: frozenset(found) for node, found in pods.items()}
