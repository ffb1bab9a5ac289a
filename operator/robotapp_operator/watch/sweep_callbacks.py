"""Callbacks of the sweep: what it needs from the operator's caches, and what it reports."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence

from robotapp_api.model.names import GRANTED_PREFIX
from robotapp_claims.rules.objects import Pod, PodSpec, PodStatus
from robotapp_claims.rules.repair import ClaimConflict
from robotapp_operator.watch.cache import Cache


def granted_pods(cache: Cache) -> Iterator[Pod]:
    """Bare pods that were granted something: their claims are repaired, and compared with those of apps."""
    for pods in cache.bare_pods.values():
        for pod in pods.values():
            if any(key.startswith(GRANTED_PREFIX) for key in pod.metadata.annotations):
                spec, status = PodSpec(node_name=pod.spec.node_name), PodStatus(phase=pod.status.phase)
                yield Pod(metadata=pod.metadata, spec=spec, status=status)


class Conflicts:
    """Things with two users as the last sweep found them, by the uid of each app that is party to one, and its instance.

    on_change is called with the uid and the instance of an app whose text has changed.
    """

    def __init__(self, on_change: Callable[[str, str], None]) -> None:
        self._on_change = on_change
        self._texts: dict[str, dict[str, tuple[str, ...]]] = {}

    def take(self, found: Sequence[ClaimConflict]) -> None:
        """All conflicts that stand; those of earlier sweeps are over. Each app gets a text for its namespace."""
        texts: defaultdict[str, defaultdict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
        for conflict in found:
            for party in conflict.parties:
                if party.is_app:
                    texts[party.uid][party.instance].add(conflict.message(for_namespace=party.namespace))
        before = self._texts
        self._texts = {
            uid: {instance: tuple(sorted(found)) for instance, found in instances.items()}
            for uid, instances in texts.items()
        }
        for uid in before.keys() | self._texts.keys():
            old, new = before.get(uid, {}), self._texts.get(uid, {})
            for instance in old.keys() | new.keys():
                if old.get(instance) != new.get(instance):
                    self._on_change(uid, instance)

    def of(self, uid: str, instance: str | None = None) -> str:
        """One sentence about the conflicts of an app, or of one of its instances; "" without any."""
        instances = self._texts.get(uid, {})
        found = {text for name, texts in instances.items() if instance in (None, name) for text in texts}
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        return min(found) + more if found else ""
