"""The seven conditions: reason code, numbers, next step. lastTransitionTime moves only with the status."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from robotapp_api.model.conditions import condition
from robotapp_api.model.names import GPU, OUR_SCHEDULERS, SCHEDULER_NAME, Condition, Reason
from robotapp_api.values.approval import describe_approval
from robotapp_api.values.placement.round_trips import is_unreachable
from robotapp_api.values.quantities.times import whole_seconds
from robotapp_claims.rules.device import claimed
from robotapp_operator.plan.diff.newer import Held, version_key
from robotapp_operator.plan.spec.desired import find_deletion_time
from robotapp_operator.plan.spec.text import clip, count, count_of, shown
from robotapp_operator.plan.status.facts import AppFacts, InstanceFacts
from robotapp_operator.plan.status.latency import EdgeView
from robotapp_operator.plan.status.troubled import (
    cut_off_text,
    edge_text,
    explain_ending,
    explain_helpers,
    given_up_texts,
    lost_text,
    rank_of,
    what_is_missing,
)

MAX_CONDITION_BYTES: Final = 2048
"""Bytes of a message of a RobotApp."""
MAX_BRIEF_BYTES: Final = 256
"""Bytes of a message of a RobotAppInstance, of which there may be thousands."""


NOT_HANDED_OVER: Final = " reserved, but not handed over: no driver there gives devices to containers"
HANDED_OVER: Final = " handed over by the driver of the node"


class Verdict(NamedTuple):
    """Status True, False or Unknown with its reason and a sentence."""

    status: str
    reason: Reason
    message: str


def conditions(facts: AppFacts) -> list[dict[str, Any]]:
    """All seven as plain JSON, in the order of the enum; of an app, or by the same rules of one instance alone."""
    return [_condition(kind, _RULES[kind](facts), facts) for kind in Condition]


def ready(facts: AppFacts) -> Verdict:
    if facts.problems:
        return Verdict("False", facts.problems[0].reason, str(facts.problems[0]))
    if facts.app.spec.suspend:
        return Verdict("False", Reason.SUSPENDED, "suspended; set spec.suspend: false to start the pods")
    if facts.app.suspended:
        return Verdict("False", Reason.SUSPENDED, "every component is suspended; set replicas: 1 to start its pod")
    if facts.ended:
        return _ended(facts)
    total = sum(len(instance.wanted) for instance in facts.instances)
    up = sum(component.ready for instance in facts.instances for component in instance.wanted)
    running = [instance for instance in facts.instances if instance.ending is None or not instance.ending.is_success]
    if running and all(instance.ready for instance in running):
        return Verdict("True", Reason.ALL_READY, f"{count_of(up, total, 'component')} ready")
    return Verdict("False", *_why_not_ready(facts, up, total))


def _ended(facts: AppFacts) -> Verdict:
    """Returns what has become of an app all of whose instances have ended."""
    endings = [(instance, instance.ending) for instance in facts.instances if instance.ending is not None]
    failed = [(instance, ending) for instance, ending in endings if not ending.is_success]
    if not failed:
        last = max(ending.time for _, ending in endings)
        return Verdict(
            "False",
            Reason.COMPLETED,
            f"{count_of(len(endings), len(endings), 'instance', 'has', 'have')} completed at {last}{_describe_deletion(facts)}",
        )
    instance, ending = failed[0]
    text = _named(facts, instance, explain_ending(instance, ending))
    return Verdict(
        "False",
        ending.reason,
        f"{count_of(len(failed), len(endings), 'instance', 'has', 'have')} failed; {text}{_describe_deletion(facts)}",
    )


def _describe_deletion(facts: AppFacts) -> str:
    """Returns when an app that has ended is deleted, "" where it is not, and for one of its instances."""
    moment = None if facts.alone else find_deletion_time(facts.app, facts.completion_time)
    return f"; it is deleted at {whole_seconds(moment)} (spec.completion.ttl)" if moment else ""


def accepted(facts: AppFacts) -> Verdict:
    unclear = [instance for instance in facts.instances if instance.unclear]
    if not facts.problems and unclear and facts.alone:
        return Verdict("False", unclear[0].unclear_reason, unclear[0].unclear)
    if not facts.problems:
        notes = [*facts.notes, *_list_unclear(facts, unclear)]
        return Verdict("True", Reason.ACCEPTED, "; ".join(["the spec is understood", *notes]))
    more = f" (and {len(facts.problems) - 3} more)" if len(facts.problems) > 3 else ""
    text = "; ".join(map(str, facts.problems[:3])) + more
    return Verdict("False", facts.problems[0].reason, text)


def _list_unclear(facts: AppFacts, unclear: Sequence[InstanceFacts]) -> Iterator[str]:
    """Yields a sentence for each reason why instances cannot be made for their robots."""
    texts = {
        Reason.ROBOT_NODE_UNCLEAR: "whose primary node is unclear",
        Reason.INVALID_SPEC: "whose name does not fit into the spec",
    }
    for reason, text in texts.items():
        names = [instance.name for instance in unclear if instance.unclear_reason is reason]
        if names:
            yield (
                f"{len(names)} of {len(facts.instances)} instances are for robots {text} ({shown(names, limit=4)}): see "
                "status.troubled for what to label"
            )


def allocated(facts: AppFacts) -> Verdict:
    if facts.conflict:
        return Verdict("False", Reason.CLAIM_CONFLICT, facts.conflict)
    if facts.problems:
        return _not_accepted(facts)
    return _domains_missing(facts) or _devices_missing(facts) or _all_allocated(facts)


def _domains_missing(facts: AppFacts) -> Verdict | None:
    for instance in facts.instances:
        if instance.refusal:
            return Verdict("False", instance.refusal[0], _named(facts, instance, instance.refusal[1]))
    without = [instance for instance in facts.instances if instance.needs_domain and instance.domain is None]
    if facts.instances and not without:
        return None
    if without and all(instance.unclear for instance in without):
        return Verdict("Unknown", without[0].unclear_reason, _named(facts, without[0], without[0].unclear))
    return Verdict(
        "Unknown",
        Reason.PENDING,
        f"{count_of(len(without), len(facts.instances), 'instance', 'waits', 'wait')} for a domain",
    )


def _devices_missing(facts: AppFacts) -> Verdict | None:
    held, wanted = _devices(facts)
    for instance in facts.instances:
        if instance.lost:
            return Verdict("False", Reason.DEVICE_LOST, _named(facts, instance, lost_text(instance)))
    served = all(instance.any_scheduler for instance in facts.instances if instance.devices_wanted)
    if wanted and not facts.app.our_scheduler and not served:
        text = (
            f"scheduler {facts.app.scheduler_name} claims no devices, so their use is unknown; {_our_scheduler(facts)}"
        )
        return Verdict("Unknown", Reason.NOT_OUR_SCHEDULER, text)
    if facts.app.suspended:
        return None
    for instance in facts.instances:
        if instance.missing_device and not instance.bound:
            return Verdict("False", Reason.WAITING_FOR_DEVICES, _named(facts, instance, instance.missing_device))
    for instance in facts.instances:
        if instance.busy:
            return Verdict("False", Reason.DEVICE_BUSY, _named(facts, instance, instance.busy))
    if held >= wanted:
        return None
    text = f"{count_of(held, wanted, 'device')} claimed; kubectl robotapp explain {facts.app.name} shows what each node lacks"
    notes = [_named(facts, instance, instance.ledger_note) for instance in facts.instances if instance.ledger_note]
    return Verdict("False", Reason.WAITING_FOR_DEVICES, "; ".join([text, *notes[:1]]))


def _our_scheduler(facts: AppFacts) -> str:
    ours = facts.app.default_scheduler in OUR_SCHEDULERS
    return "leave spec.schedulerName out" if ours else f"write spec.schedulerName: {SCHEDULER_NAME}"


_NEEDS_NOTHING: Final = "the app needs neither a domain nor devices"


def _all_allocated(facts: AppFacts) -> Verdict:
    held, wanted = _devices(facts)
    domains = sorted({instance.domain for instance in facts.instances if instance.domain is not None})
    free = _unclaimed_text(facts)
    notes = [_named(facts, instance, instance.ledger_note) for instance in facts.instances if instance.ledger_note][:1]
    if not domains and not wanted:
        have_ended = bool(facts.instances) and all(instance.ending is not None for instance in facts.instances)
        without = "every instance has ended and has given back what it had" if have_ended else _NEEDS_NOTHING
        text = f"nothing has to be claimed: {free}" if free else without
        return Verdict("True", Reason.NOTHING_TO_ALLOCATE, "; ".join([text, *notes]))
    parts = [f"domain {shown(domains)}"] if domains else []
    parts += [f"{count_of(held, wanted, 'device', '', '').rstrip()}{_ledger_text(facts, held)}"] if wanted else []
    parts += notes
    parts += [free] if free else []
    asked = facts.app.requested_domain
    if asked is not None and facts.app.share_with and domains != [asked]:
        parts.append(f"spec.ros2.domain {asked} is not used, ros2.shareWith decides; remove one of the two")
    return Verdict("True", Reason.ALLOCATED, "; ".join(parts))


def _ledger_text(facts: AppFacts, held: int) -> str:
    """Returns how the held devices reach the containers."""
    given = min(held, sum(instance.devices_handed_over for instance in facts.instances))
    if not held:
        return ""
    if not given:
        return NOT_HANDED_OVER
    return HANDED_OVER if given == held else f", {given} of them{HANDED_OVER}, the others reserved alone"


def _unclaimed_text(facts: AppFacts) -> str:
    """Devices in the spec that no claim of ours stands for: whether they are there shows when the pods are placed."""
    wishes = [device for component in facts.app.spec.components for device in component.devices if not claimed(device)]
    gpus = sum(device.type == GPU for device in wishes)
    parts = [f"{gpus} handed out by a device plugin ({GPU})"] if gpus else []
    parts += [f"{len(wishes) - gpus} shared"] if len(wishes) > gpus else []
    return f"devices without a claim: {', '.join(parts)}" if parts else ""


def _devices(facts: AppFacts) -> tuple[int, int]:
    """Held, and wanted."""
    return (
        sum(instance.devices_held for instance in facts.instances),
        sum(instance.devices_wanted for instance in facts.instances),
    )


def placed(facts: AppFacts) -> Verdict:
    if facts.problems:
        return _not_accepted(facts)
    if facts.app.suspended:
        return Verdict("Unknown", Reason.SUSPENDED, "no pods while suspended")
    if facts.ended:
        return Verdict("Unknown", _ended(facts).reason, "no pods: every instance has ended")
    parts = [component for instance in facts.begun for component in instance.wanted]
    bound = sum(component.bound for component in parts)
    for instance in facts.instances:
        for component in instance.components:
            if component.reason == Reason.UNSCHEDULABLE:
                text = _named(facts, instance, f"{component.name}: {component.message}")
                if facts.app.our_scheduler:
                    text = f"{text.rstrip('.')}; kubectl robotapp explain {facts.app.name} shows every node's reason"
                return Verdict("False", Reason.UNSCHEDULABLE, f"{bound} of {len(parts)} placed; {text}")
    for instance in facts.instances:
        failure = None if instance.ready else explain_helpers(instance)
        if failure and failure[0] is Reason.UNSCHEDULABLE:
            text = _named(facts, instance, failure[1])
            return Verdict("False", Reason.UNSCHEDULABLE, f"{bound} of {len(parts)} placed; {text}")
    if parts and bound == len(parts):
        nodes = sorted({node for component in parts for node in component.nodes})
        text = f"{count_of(bound, len(parts), 'component', 'on', 'on')} {shown(nodes)}"
        lost = [_named(facts, instance, each) for instance in facts.instances for each in given_up_texts(instance)]
        if lost:
            return Verdict("True", Reason.FALLBACK_USED, f"{text}; given up: {shown(lost, limit=4)}")
        return Verdict("True", Reason.PLACED, text)
    waiting = next((component for component in parts if component.waits), None)
    more = f"; {waiting.name} {waiting.message}" if waiting else ""
    return Verdict(
        "Unknown",
        Reason.WAITING_FOR_PODS,
        f"{count_of(bound, len(parts), 'component', 'has all its', 'have all their')} pods on nodes{more}",
    )


def budget_met(facts: AppFacts) -> Verdict:
    if facts.problems:
        return _not_accepted(facts)
    edges = [edge for instance in facts.instances for edge in instance.edges if edge.budget_us is not None]
    planned = sum(edge.latency is not None for edge in facts.app.edges_in_use)
    if planned and facts.app.suspended:
        return Verdict("Unknown", Reason.SUSPENDED, "nothing is measured while suspended")
    if planned and facts.ended:
        return Verdict("Unknown", _ended(facts).reason, "nothing is measured: every instance has ended")
    if planned and not edges:
        return Verdict(
            "Unknown",
            Reason.NOT_MEASURED,
            f"{count(planned, 'edge', 'has', 'have')} a budget; there is no instance yet",
        )
    if not edges:
        own = any(component.policies.latency_budget for component in facts.app.spec.components)
        more = "; those under policies decide about places alone" if own else ""
        return Verdict("True", Reason.NO_BUDGET, f"no edge has a latency budget{more}")
    over = [edge for edge in edges if edge.met is False]
    if over:
        worst = max(over, key=lambda edge: edge.use)
        its_first = sorted(facts.instances, key=lambda one: worst not in one.edges)
        stays = next((_named(facts, one, one.stays) for one in its_first if one.stays), "")
        text = f"{count_of(len(over), len(edges), 'edge')} over budget, worst {edge_text(worst)}; {stays or _closer(worst)}"
        return Verdict("False", Reason.BUDGET_EXCEEDED, text)
    unknown = [edge for edge in edges if edge.met is None]
    if unknown:
        return Verdict(
            "Unknown",
            Reason.NOT_MEASURED,
            f"{count_of(len(unknown), len(edges), 'edge', 'has', 'have')} no recent measurement, for example {edge_text(unknown[0])}; {_missing(unknown[0])}",
        )
    worst = max(edges, key=lambda edge: edge.use)
    return Verdict(
        "True",
        Reason.WITHIN_BUDGET,
        f"{count_of(len(edges), len(edges), 'edge')} within budget, tightest {edge_text(worst)}",
    )


def progressing(facts: AppFacts) -> Verdict:
    if newer := newer_templates(facts):
        return Verdict("False", Reason.NEWER_VERSION, newer)
    held = [item for instance in facts.instances for item in instance.held]
    if held:
        return Verdict(
            "False",
            Reason.UPDATE_HELD,
            f"{count(len(held), 'template', 'of a newer operator waits', 'of a newer operator wait')}; annotate {describe_approval(held[0].ours)} to roll them",
        )
    if facts.problems or facts.app.suspended:
        return Verdict("False", Reason.UP_TO_DATE, "nothing to roll out")
    stuck = next((instance for instance in facts.instances if instance.trouble), None)
    if stuck is not None and stuck.trouble is not None:
        text = f"the newest templates cannot be written: {stuck.trouble[1]}"
        return Verdict("False", stuck.trouble[0], _named(facts, stuck, text))
    blocked = [instance for instance in facts.instances if _blocked(instance)]
    going = [instance for instance in facts.instances if not _blocked(instance) and instance.ending is None]
    rolling = [component.name for instance in going for component in instance.components if component.rolling]
    if not facts.instances:
        return Verdict("True", Reason.ROLLING_OUT, "no instance yet")
    if rolling:
        return Verdict(
            "True", Reason.ROLLING_OUT, f"{count(len(rolling), 'component')} rolling out: {shown(sorted(set(rolling)))}"
        )
    waiting = [(instance, text) for instance in facts.instances for text in instance.config_held]
    if waiting:
        return Verdict("False", Reason.CONFIG_HELD, _named(facts, *waiting[0]))
    if blocked:
        reason, what = _blocked_by(blocked[0])
        waiting_text = count_of(len(blocked), len(facts.instances), "instance", "waits", "wait")
        return Verdict("False", reason, f"{waiting_text} for {what}")
    return Verdict("False", Reason.UP_TO_DATE, "every component has its newest template")


def held_by_newer(facts: AppFacts) -> list[Held]:
    """Templates of a newer operator that hold an edit back."""
    return [item for instance in facts.instances for item in instance.held if item.newer]


def newer_templates(facts: AppFacts) -> str:
    """How many templates of a newer operator hold an edit back and what to do; "" when none does."""
    held = held_by_newer(facts)
    if not held:
        return ""
    newest = max(held, key=lambda item: version_key(item.newer))
    return (
        f"{len(held)} {'template was' if len(held) == 1 else 'templates were'} written by operator {newest.newer}, which is newer than this one ({newest.ours}): "
        "suspend, replicas, images and domains act, other edits wait; run the newer operator again, "
        f"or annotate {describe_approval(newest.ours)} to have this one write its own templates"
    )


def _blocked_by(instance: InstanceFacts) -> tuple[Reason, str]:
    """Returns for what such an instance waits."""
    if instance.refusal:
        return instance.refusal[0], "a domain"
    if instance.unclear_reason is Reason.ROBOT_NODE_UNCLEAR:
        return Reason.ROBOT_NODE_UNCLEAR, "it to be clear which node is their robot's"
    return instance.unclear_reason, "a name of their robot that fits into the spec"


def _blocked(instance: InstanceFacts) -> bool:
    """Is there nothing to roll out, because the instance may not start?"""
    return bool(instance.refusal or (instance.unclear and not instance.exists))


def stalled(facts: AppFacts) -> Verdict:
    if facts.problems:
        cure = "a change of the spec" if facts.refused else "a change of the cluster or of the spec"
        return Verdict("True", facts.problems[0].reason, f"waits for {cure}: {facts.problems[0]}")
    if facts.bug:
        return Verdict("True", Reason.RECONCILE_ERROR, facts.bug)
    for instance in facts.instances:
        if instance.trouble:
            return Verdict("True", instance.trouble[0], _named(facts, instance, instance.trouble[1]))
    for instance in facts.instances:
        if instance.cut_off:
            return Verdict("True", Reason.RESTART_NEEDED, _named(facts, instance, cut_off_text(instance)))
    return Verdict("False", Reason.NOT_STALLED, "reconciling works")


_RULES: Final[Mapping[Condition, Callable[[AppFacts], Verdict]]] = {
    Condition.READY: ready,
    Condition.ACCEPTED: accepted,
    Condition.ALLOCATED: allocated,
    Condition.PLACED: placed,
    Condition.BUDGET_MET: budget_met,
    Condition.PROGRESSING: progressing,
    Condition.STALLED: stalled,
}


def _closer(edge: EdgeView) -> str:
    """What to do about an edge that exceeds its budget."""
    if is_unreachable(edge.judged_us):
        return f"probes between {' and '.join(edge.nodes)} get no answer: check the network between them"
    return "move a component closer, or raise the budget"


def _missing(edge: EdgeView) -> str:
    """Why an edge has no time."""
    if not all(edge.nodes):
        return "its two ends are not both on nodes"
    return f"see status.rtt and status.seq of kubectl get nodetelemetry {' '.join(edge.nodes)} -o yaml"


def _why_not_ready(facts: AppFacts, up: int, total: int) -> tuple[Reason, str]:
    """Why the instance that needs attention most is not ready."""
    waiting = [instance for instance in facts.instances if not instance.ready]
    waiting = [one for one in waiting if one.ending is None or not one.ending.is_success]
    progress = _describe_sweep(facts)
    readiness = progress or f"{count_of(up, total, 'component')} ready"
    if not waiting:
        return Reason.COMPONENTS_NOT_READY, f"{readiness}; no instance yet"
    instance = min((one for one in waiting if one in facts.begun), key=rank_of, default=waiting[0])
    if missing := what_is_missing(instance):
        return missing[0], f"{progress}{'; ' if progress else ''}{_named(facts, instance, missing[1])}"
    worst = instance.worst
    if (worst is None or not worst.reason) and (failure := explain_helpers(instance)):
        return failure[0], f"{readiness}; {_named(facts, instance, failure[1])}"
    if worst is None:
        return (
            Reason.COMPONENTS_NOT_READY,
            f"{readiness}; {_named(facts, instance, 'its discovery or master is not ready')}",
        )
    text = worst.message or ("is starting" if worst.exists else "is being created")
    return (
        worst.reason or Reason.COMPONENTS_NOT_READY,
        f"{readiness}; {_named(facts, instance, f'{worst.name}: {text}')}",
    )


def _describe_sweep(facts: AppFacts) -> str:
    """Returns how far a sweep is, "" for another app and for one instance."""
    if facts.app.spec.matrix is None or facts.alone:
        return ""
    ended = sum(instance.ending is not None for instance in facts.instances)
    waiting = sum(not instance.has_begun for instance in facts.instances)
    failed = sum(instance.ending is not None and not instance.ending.is_success for instance in facts.instances)
    text = f"{ended} of {len(facts.instances)} instances have ended{f' ({failed} failed)' if failed else ''}"
    return f"{text}, {waiting} still to begin" if waiting else text


def _not_accepted(facts: AppFacts) -> Verdict:
    return Verdict("Unknown", facts.problems[0].reason, "waits for an accepted spec")


def _named(facts: AppFacts, instance: InstanceFacts, text: str) -> str:
    """The text with the instance it is about, unless the whole status is about that one."""
    return f"{instance.name}: {text}" if instance.name and not facts.alone else text


def _items(value: object) -> list[dict[str, Any]]:
    return [item for item in value if isinstance(item, dict)] if isinstance(value, list) else []


def _condition(kind: Condition, verdict: Verdict, facts: AppFacts) -> dict[str, Any]:
    return condition(
        kind.value,
        verdict.status,
        verdict.reason.value,
        clip(verdict.message, MAX_BRIEF_BYTES if facts.alone else MAX_CONDITION_BYTES),
        before=_items(facts.previous.get("conditions")),
        generation=facts.generation,
        now=facts.now,
    )
