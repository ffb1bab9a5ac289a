"""What the sweep asks of the operator, and what it tells."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence

from robotapp_api.claims.objects import Pod, PodSpec, PodStatus
from robotapp_api.claims.repair import ClaimConflict
from robotapp_api.model.names import GRANTED_PREFIX
from robotapp_operator.cache import Cache


def granted_pods(cache: Cache) -> Iterator[Pod]:
    """Bare pods that were granted something: their claims are repaired, and compared with those of apps."""
    for pods in cache.bare_pods.values():
        for pod in pods.values():
            if any(key.startswith(GRANTED_PREFIX) for key in pod.metadata.annotations):
                spec, status = PodSpec(node_name=pod.spec.node_name), PodStatus(phase=pod.status.phase)
                yield Pod(metadata=pod.metadata, spec=spec, status=status)


class Conflicts:
    """Things with two users as the last sweep found them, by the uid of each app that is party to one.

    on_change is called with the uid of an app whose text is another one now.
    """

    def __init__(self, on_change: Callable[[str], None]) -> None:
        self._on_change = on_change
        self._texts: dict[str, tuple[str, ...]] = {}

    def take(self, found: Sequence[ClaimConflict]) -> None:
        """All conflicts that stand; those of earlier sweeps are over. Each app is told in words for its namespace."""
        texts: defaultdict[str, set[str]] = defaultdict(set)
        for conflict in found:
            for party in conflict.parties:
                if party.is_app:
                    texts[party.uid].add(conflict.message(for_namespace=party.namespace))
        before, self._texts = self._texts, {uid: tuple(sorted(said)) for uid, said in texts.items()}
        for uid in before.keys() | self._texts.keys():
            if before.get(uid) != self._texts.get(uid):
                self._on_change(uid)

    def of(self, uid: str) -> str:
        """One sentence about an app's conflicts, "" without any."""
        texts = self._texts.get(uid, ())
        more = f" (and {len(texts) - 1} more)" if len(texts) > 1 else ""
        return texts[0] + more if texts else ""
