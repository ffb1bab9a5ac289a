"""Placed pods find the set of their labels, whether they share them as one object or only have equal ones."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from robotapp_scheduler.core.selectors.label_sets import LabelSet, LabelSets, label_key

POOL = [{"app": "a"}, {"app": "a"}, {"app": "b"}, {}, {}]
"""Equal ones among them, and each may be that of pods in two namespaces."""
STEPS = st.lists(
    st.tuples(st.sampled_from(["one", "two"]), st.integers(0, len(POOL) - 1), st.booleans(), st.integers(0, 30)),
    max_size=40,
)


@given(STEPS)
def test_sets_count_the_pods_of_equal_labels_in_each_namespace(steps: list[tuple[str, int, bool, int]]) -> None:
    sets, placed, counted = LabelSets(), list[LabelSet](), Counter[object]()
    for namespace, index, again, leaving in steps:
        if leaving < len(placed):
            gone = placed.pop(leaving)
            counted[label_key(gone.namespace, gone.labels)] -= 1
            sets.release(gone)
            continue
        # The second pod of a kind often brings the labels its like share already.
        labels = (sets.like(namespace, POOL[index]) if again else None) or POOL[index]
        key = label_key(namespace, labels)
        found, new = sets.take(namespace, labels)
        assert (found.namespace, found.labels, new) == (namespace, labels, not counted[key])
        placed.append(found)
        counted[key] += 1
        assert found.pods == counted[key]
    assert len(sets) == len(+counted)
    for namespace in ("one", "two"):
        for labels in POOL:
            shared = sets.like(namespace, labels)
            assert (shared is not None) == (counted[label_key(namespace, labels)] > 0)
            assert shared is None or shared == labels
