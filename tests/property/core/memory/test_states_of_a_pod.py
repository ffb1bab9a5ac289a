"""Two states of one pod: what is recognised as unchanged is unchanged to every rule, and sharing parts changes nothing."""

from typing import Any

import msgspec
from hypothesis import given
from hypothesis import strategies as st
from tests.support.scheduling import make_pod, owner

from robotapp_scheduler.core.api.core_v1 import Pod
from robotapp_scheduler.core.pods.interning import Interner
from robotapp_scheduler.core.pods.pod_signature import PodSignatures, same_signature

FIELDS: dict[str, st.SearchStrategy[Any]] = {
    "labels": st.sampled_from(({}, {"a": "x"}, {"a": "y"}, {"a": "x", "b": "x"})),  # sorted by name, as on the wire
    "annotations": st.dictionaries(st.just("note"), st.sampled_from("xy"), max_size=1),
    "owner": st.sampled_from((None, owner("ReplicaSet", "rs", "u1"), owner("ReplicaSet", "rs", "u2"))),
    "priority": st.sampled_from((0, 5)),
    "cpu": st.sampled_from(("100m", "200m")),
    "nodeSelector": st.dictionaries(st.just("disk"), st.sampled_from(("ssd", "hdd")), max_size=1),
    "tolerations": st.sampled_from(([], [{"operator": "Exists"}])),
    "hostUsers": st.booleans(),
    "volumes": st.sampled_from(([], [{"name": "v", "persistentVolumeClaim": {"claimName": "c"}}])),
    "resourceClaims": st.sampled_from(([], [{"name": "gpu"}])),
    "node": st.sampled_from(("", "n1")),
}
STATUS = {
    "phase": st.sampled_from(("Pending", "Running")),
    "allocatedResources": st.sampled_from((None, {"cpu": "1"})),
    "resourceClaimStatuses": st.sampled_from(([], [{"name": "gpu", "resourceClaimName": "g-1"}])),
}


@st.composite
def states(draw: st.DrawFn) -> tuple[Pod, Pod]:
    """One pod, and the same a little later: most of it is as it was."""
    before = {name: draw(values) for name, values in (FIELDS | STATUS).items()}
    changed = draw(st.sets(st.sampled_from(sorted(before)), max_size=3))
    after = before | {name: draw((FIELDS | STATUS)[name]) for name in changed}
    return _pod(before), _pod(after)


def _pod(fields: dict[str, Any]) -> Pod:
    pod = make_pod(
        "p", uid="p-uid", **{name: value for name, value in fields.items() if name in FIELDS and value != []}
    )
    status = {name: fields[name] for name in STATUS if fields[name]}
    pod.status = msgspec.convert(status, type(pod.status))
    return pod


@given(states())
def test_a_pod_that_is_recognised_again_has_the_signature_it_had(pair: tuple[Pod, Pod]) -> None:
    before, after = pair
    resized = before.status.resizes or after.status.resizes
    signatures = PodSignatures()
    assert same_signature(before, before.metadata.labels or {}, after) == (
        not resized and signatures.of(before) is signatures.of(after)
    )


@given(st.lists(states(), min_size=1, max_size=4))
def test_pods_that_share_parts_say_what_they_said(pairs: list[tuple[Pod, Pod]]) -> None:
    alike = Interner()
    for pod in (pod for pair in pairs for pod in pair):
        before = msgspec.json.encode(pod)
        alike.share(pod)
        assert msgspec.json.encode(pod) == before
