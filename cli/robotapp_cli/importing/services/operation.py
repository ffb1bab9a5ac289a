"""Fields of a service about its operation: order, health, resources, replicas, labels."""

import math
import re
from fractions import Fraction
from typing import Final

from robotapp_api.values.label_key import key_problem
from robotapp_cli.importing.files.parts import Part
from robotapp_cli.importing.services.devices import take_device_reservation
from robotapp_cli.importing.services.draft import (
    Context,
    Draft,
    Json,
    format_bytes,
    read_bytes,
    read_seconds,
    report_fields,
)

_COMPLETED: Final = "service_completed_successfully"
_LABEL_VALUE: Final = re.compile(r"(([A-Za-z0-9][-A-Za-z0-9_.]*)?[A-Za-z0-9])?")
_MOST_LABELS: Final = 32
_MOST_REPLICAS: Final = 32
_CPU: Final = re.compile(r"\d{1,6}(\.\d{1,9})?")
_TIMES: Final = {"interval": "periodSeconds", "timeout": "timeoutSeconds"}
_HEALTH: Final = frozenset({"test", "interval", "timeout", "retries", "disable"})
_DEPLOY: Final = {
    "mode": "a component has replicas; for one instance per robot write spec.robots",
    "update_config": "write spec.update",
    "rollback_config": "apply the file of before to roll back",
    "restart_policy": "components are restarted whenever they end, with growing pauses",
    "placement": "write runsOn, template.spec.nodeSelector or spec.placement",
    "endpoint_mode": "a Service has one address",
    "labels": "labels of a swarm service; write template.metadata.labels for those of pods",
}


def take_depends_on(draft: Draft, part: Part) -> None:
    """Takes the order of start; a component waits until another one is ready, or complete where its program ends."""
    components, ending = draft.context.components, list_ending_services(draft.context)
    statuses: dict[str, Json] = {}
    for name, item in _list_dependencies(part):
        condition = item.get("condition") if item.fields is not None else None
        text = condition.as_text() if condition else "service_started"
        place = condition or item
        if name not in components:
            if name not in draft.context.project.services:
                draft.report.omit(item, f"{name} is no service that is imported")
            else:
                draft.report.omit(item, f"{name} is no component of the app")
        elif name in ending:
            statuses[components[name]] = {"status": "Complete"}
            if text == _COMPLETED:
                draft.report.take(place, f"dependsOn {components[name]} with status: Complete")
            else:
                draft.report.change(place, f"dependsOn {components[name]}, when it is Complete: a job is never ready")
        else:
            statuses[components[name]] = {}
            if text == "service_healthy":
                draft.report.take(place, f"dependsOn {components[name]}, when its readinessProbe succeeds")
            else:
                draft.report.take(place, f"dependsOn {components[name]}, when its container runs")
        reasons = {"restart": "a component is not restarted with another one"}
        reasons["required"] = "components that are not there are not waited for"
        report_fields(draft, item, frozenset({"condition"}), reasons)
    if statuses:
        draft.fields["dependsOn"] = [{"component": name, **status} for name, status in statuses.items()]


def list_ending_services(context: Context) -> frozenset[str]:
    """Returns the services that others wait to complete: their programs end."""
    parts = (service.get("depends_on") for service in context.project.services.values())
    return frozenset(
        name
        for part in parts
        if part is not None and part.fields is not None
        for name, item in part.fields.items()
        if item.fields is not None
        and (condition := item.get("condition")) is not None
        and condition.scalar == _COMPLETED
    )


def make_job(draft: Draft) -> None:
    """Makes the component one that ends."""
    draft.fields["job"] = {}
    draft.report.change(draft.service, "job: {}, because another service waits until it has completed")
    if draft.fields.get("replicas", 1) > 1:
        draft.fields["replicas"] = 1
        draft.report.change(draft.service, "replicas: 1, because a job runs once")


def _list_dependencies(part: Part) -> list[tuple[str, Part]]:
    if part.fields is not None:
        return list(part.fields.items())
    return [(item.as_text(), item) for item in part.as_items()]


def take_healthcheck(draft: Draft, part: Part) -> None:
    """Takes a health check as readinessProbe."""
    disable, test = part.get("disable"), part.get("test")
    reasons = {
        "start_period": "a failing readinessProbe restarts nothing, so no time is granted at the start",
        "start_interval": "one interval counts from the start on",
    }
    if disable is not None and disable.as_bool():
        draft.report.take(disable, "no probe: Kubernetes does not read the image's health check")
        report_fields(draft, part, frozenset({"disable"}), dict.fromkeys(part.fields or {}, "the check is disabled"))
        return
    command = _read_test(test) if test else []
    if not command or test is None:
        text = "Kubernetes does not read the image's health check; write test with the command"
        draft.report.omit(test or part, "no probe" if test else text)
        report_fields(draft, part, frozenset({"test"}), dict.fromkeys(part.fields or {}, "no probe is written"))
        return
    probe: Json = {"exec": {"command": command}}
    draft.report.change(test, "readinessProbe: the component is ready while it succeeds; its failure restarts nothing")
    for name, field in _TIMES.items():
        if value := part.get(name):
            probe[field] = max(1, math.ceil(read_seconds(value)))
            draft.report.take(value, f"readinessProbe.{field}: {probe[field]}")
    probe.setdefault("periodSeconds", 30)
    probe.setdefault("timeoutSeconds", 30)
    if retries := part.get("retries"):
        probe["failureThreshold"] = retries.as_int(least=0) or 1
        draft.report.take(retries, f"readinessProbe.failureThreshold: {probe['failureThreshold']}")
    draft.fields["readinessProbe"] = probe
    report_fields(draft, part, _HEALTH, reasons)


def _read_test(test: Part) -> list[str]:
    """Returns the command of a check, empty for NONE."""
    if test.items is None:
        return ["sh", "-c", test.as_text()]
    words = test.as_words()
    if words and words[0] == "CMD-SHELL":
        return ["sh", "-c", " ".join(words[1:])]
    if words and words[0] in {"CMD", "NONE"}:
        return words[1:] if words[0] == "CMD" else []
    raise test.fail("a check begins with CMD, CMD-SHELL or NONE; write one of them before the command")


def take_deploy(draft: Draft, part: Part) -> None:
    """Takes replicas and resources."""
    if replicas := part.get("replicas"):
        take_replicas(draft, replicas)
    resources = part.get("resources")
    if resources:
        for kind, field in (("limits", "limits"), ("reservations", "requests")):
            if amounts := resources.get(kind):
                _take_amounts(draft, amounts, field)
        report_fields(draft, resources, frozenset({"limits", "reservations"}))
    report_fields(draft, part, frozenset({"replicas", "resources"}), _DEPLOY)


def _take_amounts(draft: Draft, part: Part, field: str) -> None:
    if cpus := part.get("cpus"):
        _take_cpus(draft, cpus, field)
    if memory := part.get("memory"):
        _take_memory(draft, memory, field)
    devices = part.get("devices")
    for item in devices.as_items() if devices else ():
        take_device_reservation(draft, item)
    reasons = {
        "pids": "the kubelet limits processes (podPidsLimit)",
        "generic_resources": "write the node's resource by name",
    }
    report_fields(draft, part, frozenset({"cpus", "memory", "devices"}), reasons)


def take_cpus(draft: Draft, part: Part) -> None:
    """Takes the limit of CPUs."""
    _take_cpus(draft, part, "limits")


def _take_cpus(draft: Draft, part: Part, field: str) -> None:
    text = part.as_text()
    if not _CPU.fullmatch(text):
        raise part.fail(f"{text[:40]!r} is no number of CPUs; write for example 0.5")
    milli = math.ceil(Fraction(text) * 1000)
    if not milli:
        draft.report.take(part, "0 means no limit")
        return
    quantity = str(milli // 1000) if milli % 1000 == 0 else f"{milli}m"
    draft.limit(field, "cpu", quantity)
    draft.report.take(part, f"resources.{field}.cpu: {quantity}")


def take_memory(draft: Draft, part: Part) -> None:
    """Takes mem_limit and mem_reservation."""
    _take_memory(draft, part, "limits" if part.path[-1] == "mem_limit" else "requests")


def _take_memory(draft: Draft, part: Part, field: str) -> None:
    quantity = format_bytes(read_bytes(part))
    if quantity == "0":
        draft.report.take(part, "0 means no limit")
        return
    draft.limit(field, "memory", quantity)
    draft.report.take(part, f"resources.{field}.memory: {quantity}")


def take_replicas(draft: Draft, part: Part) -> None:
    """Takes the number of copies; exclusive devices allow one."""
    count = part.as_int()
    devices = draft.service.get("devices")
    if count > 1 and devices:
        draft.report.change(part, "one copy: an exclusive device allows no more; write sharing: Cluster on the device")
        return
    number = min(count, _MOST_REPLICAS)
    if number != 1:
        draft.fields["replicas"] = number
    verdict = draft.report.take if number == count else draft.report.change
    verdict(part, f"replicas: {number}")


def take_labels(draft: Draft, part: Part) -> None:
    """Takes labels and annotations where Kubernetes allows their keys."""
    is_label = part.path[-1] == "labels"
    for name, value, _ in part.list_pairs():
        text = value.as_text()
        fits = is_label and _LABEL_VALUE.fullmatch(text) and len(text) <= 63
        table = draft.metadata.setdefault("labels" if fits else "annotations", {})
        if key_problem(name if fits else name.lower()) or _is_reserved(name):
            draft.report.omit(value, f"{name!r} cannot be a key here; write one such as example.com/team")
        elif len(table) >= _MOST_LABELS or len(text) > 4096:
            draft.report.omit(value, f"a pod has {_MOST_LABELS} labels of its own at most")
        else:
            table[name] = text
            draft.report.take(value, f"template.metadata.{'labels' if fits else 'annotations'}: {name}")
    draft.metadata = {kind: table for kind, table in draft.metadata.items() if table}


def _is_reserved(key: str) -> bool:
    prefix = key.rpartition("/")[0]
    return prefix in {"app.kubernetes.io", "robotics.io"} or prefix.endswith(".robotics.io")
