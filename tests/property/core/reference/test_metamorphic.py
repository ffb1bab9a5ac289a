"""What must not change a decision: the order of nodes, a node nobody can use, the way an amount is written or split."""

from copy import deepcopy
from dataclasses import dataclass, replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.support.seeds import count_examples

from campaigns.cluster_cases import FAMILIES, Case, cases
from campaigns.cluster_cases.scene import Json, make_node
from campaigns.reference_scheduler import decide
from campaigns.reference_scheduler.comparison import build
from campaigns.reference_scheduler.quantities import exact
from robotapp_api.model.names import SCHEDULER_NAME
from robotapp_scheduler.core.runtime.profile_runner import ProfileRunner

CHECKS = settings(
    max_examples=count_examples(80),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
WITHOUT_IMAGES = [name for name in FAMILIES if name != "images"]
"""ImageLocality does depend on the number of nodes and of containers."""


@dataclass(frozen=True)
class Answer:
    """The product's whole answer, by node name."""

    refusals: dict[str, tuple[str, tuple[str, ...]]]
    totals: dict[str, int]
    error: bool = False


def answer(case: Case, *, caching: bool = True) -> Answer:
    core, pod = build(case)
    engine = core.runner(SCHEDULER_NAME)
    if not caching:
        engine = ProfileRunner(engine.profile, core.cluster, caching=False)
    narrowed = engine.pre_filter(pod)
    if narrowed.status is not None:
        return Answer({}, {}, error=True)
    evaluation = engine.evaluate(pod, narrowed.names)
    refusals, feasible = {}, []
    for position, code in enumerate(evaluation.reason):
        if code > 0:
            reason = evaluation.reasons.values[code]
            refusals[engine.name_of(evaluation, position)] = (reason.plugin, tuple(sorted(reason.texts)))
        elif code == 0:
            feasible.append(position)
    totals: dict[str, int] = {}
    if len(feasible) > 1 and not decide(case.cluster, case.pod).error:
        engine.score(pod, evaluation)
        found = evaluation.totals
        totals = {engine.name_of(evaluation, position): int(found[position]) for position in feasible}
    return Answer(refusals, totals)


def changed(case: Case, *, nodes: list[Json] | None = None, pod: Json | None = None) -> Case:
    """Other nodes in their places, or another pod to place."""
    rest = [each for each in case.objects[:-1] if each["kind"] != "Node"]
    if nodes is None:
        nodes = [each for each in case.objects if each["kind"] == "Node"]
    return replace(case, objects=(*nodes, *rest, pod or case.objects[-1]))


def nodes_of(case: Case) -> list[Json]:
    return [each for each in case.objects if each["kind"] == "Node"]


@CHECKS
@given(cases(list(FAMILIES)), st.randoms(use_true_random=False))
def test_the_order_of_nodes_decides_nothing(case: Case, random: st.random_module) -> None:
    nodes = nodes_of(case)
    random.shuffle(nodes)
    assert answer(changed(case, nodes=nodes)) == answer(case)


@CHECKS
@given(cases(WITHOUT_IMAGES))
def test_a_node_nobody_can_use_changes_nothing_for_the_others(case: Case) -> None:
    useless = make_node("useless", pods="0")
    useless["metadata"]["labels"] = {}
    with_it = answer(changed(case, nodes=[useless, *nodes_of(case)]))
    refusals = {name: each for name, each in with_it.refusals.items() if name != "useless"}
    assert replace(with_it, refusals=refusals) == answer(case)


@CHECKS
@given(cases(list(FAMILIES)))
def test_the_way_an_amount_is_written_changes_nothing(case: Case) -> None:
    written = tuple(rewritten(each) for each in case.objects)
    assert answer(replace(case, objects=written)) == answer(case)


def rewritten(item: Json) -> Json:
    """cpu in milli, everything else in thousandths of a unit; the same amounts."""
    made = deepcopy(item)
    if made["kind"] == "Node":
        _rewrite(made["status"]["allocatable"])
    if made["kind"] == "Pod":
        spec, status = made["spec"], made["status"]
        statuses = [*status.get("containerStatuses", []), *status.get("initContainerStatuses", [])]
        for holder in [spec, *spec["containers"], *spec.get("initContainers", []), *statuses]:
            _rewrite(holder.get("resources", {}).get("requests", {}))
            _rewrite(holder.get("allocatedResources", {}))
        _rewrite(spec.get("overhead", {}))
    return made


def _rewrite(amounts: Json) -> None:
    for name, text in amounts.items():
        thousandths = exact(text) * 1000
        if thousandths < 2**60:
            amounts[name] = f"{-(-thousandths.numerator // thousandths.denominator)}m"


@pytest.mark.parametrize(("text", "expected"), [("1", "1000m"), ("0.5", "500m"), ("1Ki", "1024000m"), ("0.0001", "1m")])
def test_amounts_are_rewritten_to_the_same_amount(text: str, expected: str) -> None:
    amounts = {"cpu": text}
    _rewrite(amounts)
    assert amounts == {"cpu": expected}


@CHECKS
@given(cases(WITHOUT_IMAGES), st.integers(0, 8))
def test_two_containers_that_share_the_work_of_one_change_nothing(case: Case, part: int) -> None:
    pod = deepcopy(case.objects[-1])
    first = pod["spec"]["containers"][0]
    requests = first.get("resources", {}).get("requests", {})
    if "cpu" not in requests or "memory" not in requests:
        # Each container without a request counts as asking for a default: two of them are not one.
        return
    other: Json = {"name": "half", "image": first["image"], "resources": {"requests": {}}}
    for name, unit in (("cpu", 1000), ("memory", 1)):
        whole = -(-(exact(requests[name]) * unit).numerator // (exact(requests[name]) * unit).denominator)
        mine = whole * part // 8
        suffix = "m" if name == "cpu" else ""
        requests[name], other["resources"]["requests"][name] = f"{mine}{suffix}", f"{whole - mine}{suffix}"
    pod["spec"]["containers"].append(other)
    assert answer(changed(case, pod=pod)) == answer(case)


@CHECKS
@given(cases(list(FAMILIES)))
def test_caches_change_nothing(case: Case) -> None:
    assert answer(case, caching=False) == answer(case)
