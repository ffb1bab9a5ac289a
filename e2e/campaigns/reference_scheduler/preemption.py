"""DefaultPreemption: which pods would have to go so that the pod fits, and on which node that hurts least."""

from collections.abc import Callable

from campaigns.reference_scheduler import filtering
from campaigns.reference_scheduler.labels import labels_of, selector_matches
from campaigns.reference_scheduler.model import Json
from campaigns.reference_scheduler.outcome import NO_VICTIMS, NOT_HELPFUL, Decision, Preemption, histogram
from campaigns.reference_scheduler.state import State, identity, name_of, namespace_of, priority_of, terminating

_NEVER_STARTED = "9999"  # sorts after every RFC 3339 time: upstream takes such a pod as starting now
_OFFSET = 2**31


def preempt(state: State, decision: Decision) -> Preemption:
    """What becomes of it, in the words of the release."""
    found = _decided(state, decision)
    if state.config.compat_version == "1.35":
        found.silent = True
        found.tail = "" if found.victims else f"no new claims to deallocate, {found.tail}"
    return found


def _decided(state: State, decision: Decision) -> Preemption:
    """Every node that might help is tried: the limit on candidates (at least 100) is not reached in small clusters."""
    found = Preemption()
    if state.pod["spec"].get("preemptionPolicy") == "Never":
        found.tail = "preemption: not eligible due to preemptionPolicy=Never."
        return found
    if _waits_for_victims(state, decision):
        found.tail = "preemption: not eligible due to a terminating pod on the nominated node."
        return found
    texts = []
    for node in state.nodes:
        name = name_of(node)
        rejection = decision.refused or decision.rejections[name]
        refusal = [NOT_HELPFUL] if rejection.final else _try(state, node, found)
        if refusal:
            found.refusals[name] = ", ".join(refusal)
            texts += refusal
    if found.victims:
        found.best = _least_harm(state, found)
        found.tail = found.tail_for(min(found.best, key=list(found.victims).index))
    else:
        found.tail = f"preemption: {histogram(len(state.nodes), texts)}"
    return found


def _waits_for_victims(state: State, decision: Decision) -> bool:
    """A victim of ours is still terminating on the nominated node."""
    nominated = (state.pod.get("status") or {}).get("nominatedNodeName")
    if not nominated or nominated not in state.placed:
        return False
    rejection = decision.rejections.get(nominated)
    if rejection is not None and rejection.final:
        return False
    return any(
        priority_of(other) < priority_of(state.pod) and terminating(other) and _preempted(other)
        for other in state.placed[nominated]
    )


def _preempted(pod: Json) -> bool:
    return any(
        (each["type"], each["status"], each.get("reason")) == ("DisruptionTarget", "True", "PreemptionByScheduler")
        for each in (pod.get("status") or {}).get("conditions") or []
    )


def _try(state: State, node: Json, found: Preemption) -> list[str]:
    """A dry run on one node: notes the victims in `found`, or tells why it is no candidate."""
    lower = [other for other in state.on(node) if priority_of(other) < priority_of(state.pod)]
    if not lower:
        return [NO_VICTIMS]
    kept = [other for other in state.on(node) if priority_of(other) >= priority_of(state.pod)]
    if refused := filtering.refusal(state.with_pods(node, kept), node):
        return list(refused.texts)
    violating, others = _by_budget(state, sorted(lower, key=importance))
    victims = []
    for other in [*violating, *others]:
        if filtering.refusal(state.with_pods(node, [*kept, other]), node) is None:
            kept.append(other)
        else:
            victims.append(other)
    name = name_of(node)
    found.violations[name] = sum(1 for victim in victims if any(victim is each for each in violating))
    found.victims[name] = [identity(victim) for victim in sorted(victims, key=importance)]
    return []


def started(pod: Json) -> str:
    """RFC 3339 in UTC, so that texts sort like times."""
    return str((pod.get("status") or {}).get("startTime") or _NEVER_STARTED)


def importance(pod: Json) -> tuple[int, str]:
    """Sort key: the most important pod first."""
    return -priority_of(pod), started(pod)


def _by_budget(state: State, pods: list[Json]) -> tuple[list[Json], list[Json]]:
    """(those whose eviction breaks a disruption budget, the others); `pods` by importance."""
    left = {
        id(each): int((each.get("status") or {}).get("disruptionsAllowed") or 0)
        for each in state.cluster.disruption_budgets
    }
    violating, others = [], []
    for pod in pods:
        broken = False
        for budget in state.cluster.disruption_budgets:
            if not broken and _covers(budget, pod):
                left[id(budget)] -= 1
                broken = left[id(budget)] < 0
        (violating if broken else others).append(pod)
    return violating, others


def _covers(budget: Json, pod: Json) -> bool:
    """A budget with `selector: {}` covers every pod, as from 1.38 on: 1.37 ignores it, which is less safe."""
    disrupted = (budget.get("status") or {}).get("disruptedPods") or {}
    return (
        namespace_of(budget) == namespace_of(pod)
        and bool(labels_of(pod))
        and selector_matches(budget["spec"].get("selector"), labels_of(pod))
        and name_of(pod) not in disrupted
    )


def _least_harm(state: State, found: Preemption) -> frozenset[str]:
    """One rule after the other until a single node is left."""
    pods = {identity(pod): pod for name in found.victims for pod in state.placed[name]}
    gone = {name: [pods[uid] for uid in uids] for name, uids in found.victims.items()}
    rules: list[Callable[[str], int]] = [
        lambda name: found.violations[name],
        lambda name: priority_of(gone[name][0]),
        lambda name: sum(priority_of(pod) + _OFFSET for pod in gone[name]),
        lambda name: len(gone[name]),
    ]
    left = list(gone)
    for rule in rules:
        least = min(rule(name) for name in left)
        left = [name for name in left if rule(name) == least]
    latest = max(_first_start(gone[name]) for name in left)
    return frozenset(name for name in left if _first_start(gone[name]) == latest)


def _first_start(victims: list[Json]) -> str:
    """The earliest start among the victims of the highest priority."""
    highest = priority_of(victims[0])
    return min(started(pod) for pod in victims if priority_of(pod) == highest)
