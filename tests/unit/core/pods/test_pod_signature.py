"""Replicas share what follows from their spec; pods that differ in anything a rule reads do not."""

from typing import Any

import pytest
from tests.support.scheduling import make_info, make_pod, owner

from robotapp_api.model.names import Annotation
from robotapp_scheduler.core.api.core_v1 import ClaimReference
from robotapp_scheduler.core.pods import pod_signature
from robotapp_scheduler.core.pods.pod_info import FEATURES, LIVE, OWN_FEATURES
from robotapp_scheduler.core.pods.pod_signature import PodSignatures

ZONE = "topology.kubernetes.io/zone"
TERM = {"topologyKey": ZONE, "labelSelector": {"matchLabels": {"app": "a"}}}
AWAY = {"podAntiAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": [TERM]}}
SSD = {"matchExpressions": [{"key": "disk", "operator": "In", "values": ["ssd"]}]}
NODES = {"nodeAffinity": {"requiredDuringSchedulingIgnoredDuringExecution": {"nodeSelectorTerms": [SSD]}}}
CONTAINER = {"name": "main", "image": "a:1", "ports": [{"hostPort": 80}], "restartPolicyRules": [{"action": "x"}]}
OTHER: dict[str, dict[str, Any]] = {
    "labels": {"labels": {"app": "b"}},
    "namespace": {"namespace": "elsewhere"},
    "owner": {"owner": owner("ReplicaSet", "web", "r1")},
    "priority": {"priority": 7},
    "requests": {"cpu": "200m"},
    "containers": {"containers": [CONTAINER]},
    "sidecar": {"initContainers": [CONTAINER | {"restartPolicy": "Always"}]},
    "overhead": {"overhead": {"cpu": "1"}},
    "pod level": {"resources": {"requests": {"cpu": "3"}}},
    "node selector": {"nodeSelector": {"disk": "ssd"}},
    "node affinity": {"affinity": NODES},
    "pod affinity": {"affinity": AWAY},
    "tolerations": {"tolerations": [{"operator": "Exists"}]},
    "spread": {"topologySpreadConstraints": [TERM]},
    "user namespaces": {"hostNetwork": True, "hostUsers": False},
    "volume": {"volumes": [{"name": "v", "persistentVolumeClaim": {"claimName": "c"}}]},
    "image volume": {"volumes": [{"name": "v", "image": {"reference": "data:1"}}]},
}


def test_replicas_that_differ_in_name_node_annotations_and_token_volume_are_one_shape() -> None:
    token = [{"name": "kube-api-access-abcde"}]
    one = make_pod("one", volumes=token, annotations={"a": "1"})
    two = make_pod("two", volumes=[{"name": "kube-api-access-vwxyz"}], node="n1")
    signatures = PodSignatures()
    assert signatures.of(one) is signatures.of(two)


@pytest.mark.parametrize("fields", OTHER.values(), ids=OTHER)
def test_a_pod_that_differs_in_something_a_rule_reads_is_another_shape(fields: dict[str, Any]) -> None:
    plain, other = make_info("plain"), make_info("other", **fields)
    assert plain.signature is not other.signature
    features = tuple(sorted(FEATURES.keys() - OWN_FEATURES - {n for n in FEATURES if n.startswith(LIVE)}))
    assert plain.features(features) != other.features(features)


def test_pods_with_other_claims_are_of_another_shape_and_those_made_for_replicas_are_not() -> None:
    claims = [{"name": "gpu"}]
    one, two = (make_pod(name, resourceClaims=claims) for name in ("one", "two"))
    two.status.resource_claim_statuses = (ClaimReference(name="gpu", resource_claim_name="two-gpu"),)
    signatures = PodSignatures()
    assert signatures.of(one) is signatures.of(two) is not signatures.of(make_pod("plain"))


@pytest.mark.parametrize("name", sorted(OWN_FEATURES))
def test_features_of_one_replica_are_never_given_to_another(name: str) -> None:
    wishes = '{"hardware_requirements": [{"type": "can"}]}'
    claims = [{"name": "gpu", "resourceClaimName": "gpu"}]
    one = make_info("one", annotations={str(Annotation.AFFINITY): wishes}, node="n1", resourceClaims=claims)
    assert one.features((name,)) != make_info("two").features((name,))


def test_a_pod_that_is_being_resized_shares_nothing() -> None:
    plain, resized = make_pod("one"), make_pod("two")
    resized.status.allocated_resources = {"cpu": "3"}
    signatures = PodSignatures()
    assert signatures.of(plain) is not signatures.of(resized)
    assert signatures.of(resized) is not signatures.of(resized)


def test_pods_with_an_ephemeral_volume_share_nothing_because_its_claim_is_named_after_the_pod() -> None:
    infos = [make_info(name, volumes=[{"name": "scratch", "ephemeral": {}}]) for name in ("one", "two")]
    assert infos[0].features(("mounts",)) != infos[1].features(("mounts",))


def test_the_signatures_that_are_kept_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    signatures = PodSignatures()
    monkeypatch.setattr(pod_signature, "MAX_SIGNATURES", 3)
    for i in range(20):
        signatures.of(make_pod(labels={"app": f"a{i}"}))
    assert int(repr(signatures).removeprefix("PodSignatures(").split()[0]) <= 3
