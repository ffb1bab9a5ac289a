"""Every field of our kinds is read by code that acts on it or shows it, or its user is told that nothing does yet.

The tables are written by hand: a new field fails the first test until its reader is named here, and a reader that no longer
reads a field fails the second.
"""

import ast
import functools
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec
import pytest
from tests.support.factories import component, make_app

from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.app.status import RobotAppStatus
from robotapp_api.model.base import Model
from robotapp_api.model.claim import ClaimSpec, ClaimStatus
from robotapp_api.model.instance import InstanceSpec, InstanceStatus, RobotAppInstance
from robotapp_api.model.pool import DEFAULT_PARTICIPANTS, PoolSpec
from robotapp_api.model.telemetry import TelemetrySpec, TelemetryStatus
from robotapp_claims.rules.objects import Pool
from robotapp_operator.plan.spec.validate import notes_of

ROOT: Final = Path(__file__).resolve().parents[3]
CHECKS, CLAIMS = "crds/robotapp_api/checks", "claims/robotapp_claims/rules"
PLAN = "operator/robotapp_operator/plan"
CORE = "scheduler/robotapp_scheduler/core"

READERS: Final[Mapping[str, str]] = {
    f"{CHECKS}/ros.py": "spec.ros.version spec.ros.distro spec.components.ros spec.ros2.rmw spec.ros2.discovery.mode",
    f"{CHECKS}/edges.py": """
        spec.edges.type
        spec.edges.qos.reliability spec.edges.qos.durability spec.edges.qos.history spec.edges.qos.depth
        spec.edges.qos.deadline spec.edges.qos.liveliness spec.edges.qos.lease
        spec.edges.requestedQos.reliability spec.edges.requestedQos.durability spec.edges.requestedQos.history
        spec.edges.requestedQos.depth spec.edges.requestedQos.deadline spec.edges.requestedQos.liveliness
        spec.edges.requestedQos.lease""",
    f"{CHECKS}/components.py": "spec.components.ready.lifecycle",
    "crds/robotapp_api/values/selector.py": """
        spec.robots.nodeSelector.matchLabels spec.robots.nodeSelector.matchExpressions.key
        spec.robots.nodeSelector.matchExpressions.operator spec.robots.nodeSelector.matchExpressions.values
        spec.overrides.nodeSelector.matchLabels spec.overrides.nodeSelector.matchExpressions.key
        spec.overrides.nodeSelector.matchExpressions.operator spec.overrides.nodeSelector.matchExpressions.values""",
    "crds/robotapp_api/values/overrides.py": """
        spec.overrides.name spec.overrides.components.name spec.overrides.components.image spec.overrides.components.env
        spec.overrides.components.resources""",
    "crds/robotapp_api/values/recordings/components.py": """
        spec.recordings.name spec.recordings.topics.names spec.recordings.topics.regex spec.recordings.topics.exclude
        spec.recordings.split.size spec.recordings.split.duration spec.recordings.retain.size spec.recordings.volume.claimName
        spec.recordings.tiers spec.recordings.image spec.recordings.imagePullPolicy spec.recordings.resources""",
    "crds/robotapp_api/values/sweeps/matrix.py": """
        spec.matrix.parameters.name spec.matrix.parameters.values spec.matrix.parallelism""",
    f"{CLAIMS}/instances.py": "spec.robots.assignment",
    f"{CLAIMS}/completion/endings.py": """
        spec.completion.success.operator spec.completion.success.components spec.completion.deadline spec.completion.maxRestarts""",
    f"{CLAIMS}/device.py": """
        spec.components.devices.type spec.components.devices.model spec.components.devices.interface
        spec.components.devices.usbID spec.components.devices.sharing""",
    f"{CLAIMS}/pools.py": "pool.network",
    f"{CLAIMS}/domain.py": "pool.scope pool.ids pool.reserved pool.quarantineSeconds pool.quota.default pool.quota.namespaces pool.sharedIds",
    f"{PLAN}/diff/diff.py": "spec.update.operator",
    f"{PLAN}/diff/config_rollout.py": "spec.update.onConfigChange",
    f"{PLAN}/spec/desired.py": """
        spec.ros2.domain spec.ros2.pool spec.ros2.transport spec.ros2.discovery.image spec.ros1.image spec.ros2.shareWith.namespace
        spec.ros2.shareWith.name spec.ros1.master spec.schedulerName spec.connectivity.grace spec.suspend
        spec.placement.reschedule.for spec.placement.reschedule.cooldown spec.components.schedule.cron
        spec.components.schedule.timeZone spec.completion.ttl""",
    f"{PLAN}/diff/schedules.py": "spec.components.schedule.startingDeadlineSeconds",
    f"{PLAN}/spec/validate.py": "spec.ros2.isolation spec.ros2.allowUnsafeDomain",
    f"{PLAN}/render/environment.py": "spec.ros1.uri",
    f"{PLAN}/render/infrastructure.py": "spec.placement.masterNode spec.ros2.external.expose",
    f"{PLAN}/render/helper_pods.py": " ".join(
        f"{helper}.{field}"
        for helper in ("spec.ros1", "spec.ros2.discovery")
        for field in (
            "imagePullPolicy",
            "resources",
            "securityContext",
            "template.metadata.labels",
            "template.metadata.annotations",
            "template.spec.imagePullSecrets",
            "template.spec.tolerations",
            "template.spec.nodeSelector",
            "template.spec.priorityClassName",
            "template.spec.serviceAccountName",
            "template.spec.securityContext",
            "template.spec.runtimeClassName",
        )
    ),
    f"{PLAN}/render/parameters.py": """
        spec.components.parameters.inline
        spec.components.parameters.configMapKeyRef.name spec.components.parameters.configMapKeyRef.key
        spec.components.parameters.configMapKeyRef.optional
        spec.components.parameters.secretKeyRef.name spec.components.parameters.secretKeyRef.key
        spec.overrides.components.parameters.inline
        spec.overrides.components.parameters.configMapKeyRef.name spec.overrides.components.parameters.configMapKeyRef.key
        spec.overrides.components.parameters.configMapKeyRef.optional
        spec.overrides.components.parameters.secretKeyRef.name spec.overrides.components.parameters.secretKeyRef.key""",
    f"{PLAN}/render/command_line.py": """
        spec.components.args
        spec.components.run.package spec.components.run.executable spec.components.run.name spec.components.run.namespace
        spec.components.run.remaps spec.components.run.args
        spec.components.launch.package spec.components.launch.file spec.components.launch.arguments
        spec.components.launch.parametersArgument""",
    f"{PLAN}/spec/dependencies.py": "spec.components.dependsOn.component spec.components.dependsOn.status",
    f"{PLAN}/render/readiness_probes.py": """
        spec.components.ready.topic.name spec.components.ready.topic.minRate
        spec.components.readinessProbe""",
    f"{PLAN}/render/pod_template.py": """
        spec.components.name spec.components.image spec.components.command
        spec.components.workingDir spec.components.env spec.components.envFrom spec.components.ports
        spec.components.volumeMounts spec.components.resources spec.components.imagePullPolicy
        spec.components.securityContext spec.components.livenessProbe spec.components.startupProbe
        spec.components.lifecycle spec.components.stdin spec.components.tty spec.components.sharedMemory.size
        spec.components.template.spec.containers spec.components.template.spec.hostNetwork spec.components.template.spec.hostIPC
        spec.components.template.spec.hostPID spec.components.template.spec.shareProcessNamespace
        spec.components.template.spec.hostAliases spec.components.template.spec.hostname spec.components.template.spec.dnsConfig
        spec.components.template.metadata.labels spec.components.template.metadata.annotations
        spec.components.template.spec.volumes spec.components.template.spec.imagePullSecrets
        spec.components.template.spec.initContainers spec.components.template.spec.nodeSelector
        spec.components.template.spec.priorityClassName spec.components.template.spec.serviceAccountName
        spec.components.template.spec.securityContext spec.components.template.spec.runtimeClassName
        spec.components.template.spec.terminationGracePeriodSeconds""",
    f"{PLAN}/render/node_affinity.py": """
        spec.components.template.spec.tolerations spec.components.runsOn spec.components.onDisconnect
        spec.components.requires.type spec.components.requires.model spec.components.requires.interface""",
    f"{PLAN}/render/deployments.py": """
        spec.components.replicas spec.components.job.backoffLimit spec.components.job.activeDeadlineSeconds""",
    "crds/robotapp_api/checks/replicas.py": "spec.components.replicaIdentity",
    f"{PLAN}/render/services.py": """
        spec.components.service.metadata.labels spec.components.service.metadata.annotations spec.components.service.spec.type
        spec.components.service.spec.ports.name spec.components.service.spec.ports.port
        spec.components.service.spec.ports.protocol spec.components.service.spec.ports.targetPort
        spec.components.service.spec.ports.nodePort spec.components.service.spec.ports.appProtocol
        spec.components.service.spec.externalTrafficPolicy spec.components.service.spec.loadBalancerClass
        spec.components.service.spec.loadBalancerSourceRanges""",
    f"{PLAN}/spec/links.py": """
        spec.components.service.links.name spec.components.service.links.port spec.components.service.links.scheme
        spec.components.service.links.path""",
    f"{PLAN}/status/latency.py": "spec.edges.latency.percentile",
    f"{PLAN}/status/device_conflicts.py": "spec.components.devices.name",
    f"{PLAN}/render/devices/variables.py": "spec.components.devices.mountAs",
    f"{PLAN}/moves/device_moves.py": "spec.components.devices.onLoss",
    f"{PLAN}/moves/rescheduling.py": "spec.placement.reschedule.when spec.placement.reschedule.maxPerDay",
    f"{CORE}/robotics/resolve.py": """
        spec.components.qosClass spec.components.policies.latencyBudget spec.components.policies.deadline
        spec.components.policies.reliability spec.components.policies.liveliness
        spec.components.sharedData.peerPods spec.components.sharedData.claimNames spec.components.devices.count
        spec.placement.zones""",
    f"{CORE}/robotics/app_index.py": """
        spec.components.sharedData.with spec.components.colocateWith spec.components.separateFrom spec.edges.kind spec.edges.topic spec.edges.from
        spec.edges.to spec.edges.latency.budget spec.edges.latency.enforce spec.placement.objective
        spec.edges.bandwidth spec.edges.rateHz spec.edges.messageBytes""",
    f"{CORE}/robotics/fallback.py": "spec.placement.fallback.steps spec.placement.fallback.after",
    f"{CORE}/cycle/all_or_nothing.py": "spec.placement.gang",
}
"""File -> the fields it reads and acts on. Of several readers, the one without which the field would do nothing."""

OBSERVED: Final[Mapping[str, str]] = {
    "operator/robotapp_operator/watch/cache.py": "telemetry.intervalSeconds telemetry.seq",
    "agent/robotapp_agent/shell/api_writer.py": "asked.probe",
    "crds/robotapp_api/values/placement/round_trips.py": """
        telemetry.rtt.peer telemetry.rtt.p50Us telemetry.rtt.p95Us telemetry.rtt.lossPPM telemetry.rtt.seq telemetry.rtt.everyRounds""",
    f"{CORE}/robotics/device_index.py": """
        telemetry.devices.type telemetry.devices.model telemetry.devices.interface telemetry.devices.identity
        telemetry.devices.present""",
    "scheduler/robotapp_scheduler/plugins/ros/load_balance.py": """
        telemetry.load.cpuPercent telemetry.load.memoryPercent telemetry.load.gpuPercent""",
    f"{CLAIMS}/node_devices.py": "telemetry.devices.id telemetry.devices.names telemetry.devices.path",
    "cli/robotapp_cli/commands/nodes.py": """
        telemetry.arch telemetry.kernel.realtime telemetry.deviceProblem telemetry.rtt.jitterUs telemetry.load.diskPercent
        telemetry.load.networkBps telemetry.temperatures.name telemetry.temperatures.celsius telemetry.battery.percent
        telemetry.battery.charging telemetry.clock.offsetMilliseconds""",
    f"{CLAIMS}/identity.py": """
        claim.domain.pool claim.domain.scope claim.domain.scopeValue claim.domain.id claim.device.node claim.device.type
        claim.device.id claim.holder.apiVersion claim.holder.kind claim.holder.namespace claim.holder.name
        claim.holder.uid claim.holder.instance claim.holder.component""",
    f"{CLAIMS}/device.py": "claim.device.identity",
    f"{CLAIMS}/release.py": "claimed.attempt",
    "claims/robotapp_claims/protocol/sweeper.py": "claimed.phase claimed.pod",
    "claims/robotapp_claims/protocol/claim_nodes.py": "claimed.nodes",
    "claims/robotapp_claims/protocol/writes.py": "claimed.node",
    "operator/robotapp_operator/watch/informers.py": "named.app named.appUID named.instance",
    "cli/robotapp_cli/reading/runs.py": "named.matrix",
    f"{PLAN}/diff/attempts.py": """
        instance.restarts.count instance.restarts.attempt instance.restarts.runHash instance.restarts.began
        instance.restarts.message""",
    "operator/robotapp_operator/reconcile/app_expiry.py": "app.completionTime",
    "cli/robotapp_cli/reading/instances.py": "instance.phase instance.domain app.troubled.instance",
    "cli/robotapp_cli/commands/apps.py": """
        app.observedGeneration app.phase app.conditions.type app.conditions.status app.conditions.reason
        app.conditions.message app.conditions.lastTransitionTime
        app.instanceCounts.desired app.instanceCounts.ready app.instanceCounts.offline app.instanceCounts.completed
        app.instanceCounts.failed app.troubled.reason app.troubled.message
        app.summary.ready app.summary.robots app.summary.domain app.summary.budget app.summary.devices app.summary.nodes
        app.summary.rmw app.summary.discovery app.summary.message
        instance.summary.ready instance.summary.budget instance.summary.devices instance.summary.nodes
        instance.summary.message
        instance.components.name instance.components.node instance.components.ready instance.components.restarts
        instance.components.message instance.components.completed instance.completionTime
        instance.helpers.name instance.helpers.node instance.helpers.ready instance.helpers.restarts instance.helpers.image
        instance.helpers.message instance.links.component instance.links.name instance.links.url
        instance.edges.kind instance.edges.topic instance.edges.from instance.edges.to instance.edges.budget
        instance.edges.p95 instance.edges.measured instance.edges.nodes instance.edgesOmitted
        instance.claims instance.moves.component instance.moves.times""",
    "rigel_bridge/rigel_bridge/sequences/comparison.py": "instance.edges.met",
    "rigel_bridge/rigel_bridge/cluster/waiting.py": "app.conditions.observedGeneration",
}
"""The same of what programs write for each other and for users: specs and statuses of NodeTelemetry (asked, telemetry), RobotClaim
(claim, claimed), RobotAppInstance (named, instance), and the status of a RobotApp (app)."""

SELECTED: Final = frozenset({"named.robot"})
"""The API server reads it: kubectl get rai --field-selector spec.robot=amr-07."""

REFUSED: Final = frozenset(
    f"spec.components.template.spec.{name}"
    for name in (
        "nodeName",
        "schedulerName",
        "restartPolicy",
        "resourceClaims",
        "schedulingGates",
        "ephemeralContainers",
    )
)
"""They stand in the schema so that the API server's refusal can name what to write instead."""

TOLD: Final[Mapping[str, dict[str, Any]]] = {
    "spec.components.policies.durability": {"components": [component(policies={"durability": "transient_local"})]},
    "spec.components.policies.queueSize": {"components": [component(policies={"queueSize": 3})]},
    "spec.components.policies.tcpNodelay": {"components": [component(policies={"tcpNodelay": True})]},
    "spec.ros2.transport": {"ros2": {"transport": "SHM"}},
}
"""Fields that wait for a later issue, or a value of them does, with a spec that sets them: `Accepted` names them."""


def fields(model: type[Model], path: str) -> Iterator[tuple[str, str]]:
    """(path as in YAML without indices, name in Python) of every field that holds a value."""
    for name, field in model.model_fields.items():
        at = f"{path}.{field.alias or name}"
        parts = list(models(field.annotation))
        if not parts:
            yield at, name
        for part in parts:
            yield from fields(part, at)


def models(annotation: Any) -> Iterator[type[Model]]:
    if isinstance(annotation, type) and issubclass(annotation, Model):
        yield annotation
    for argument in typing.get_args(annotation):
        yield from models(argument)


MODELS: Final[Mapping[str, type[Model]]] = {
    "spec": RobotAppSpec,
    "pool": PoolSpec,
    "asked": TelemetrySpec,
    "telemetry": TelemetryStatus,
    "claim": ClaimSpec,
    "claimed": ClaimStatus,
    "named": InstanceSpec,
    "instance": InstanceStatus,
    "app": RobotAppStatus,
}
PYTHON_NAMES: Final = {
    path: field
    for name, model in MODELS.items()
    for path, field in fields(model, name)
    if not path.startswith("instance.conditions.")  # the same model as an app's
}
READER_OF: Final = {
    path: file for table in (READERS, OBSERVED) for file, text in table.items() for path in text.split()
}


@functools.cache
def names_read(file: str) -> frozenset[str]:
    """Attributes and strings in a file, apart from functions that only tell the user about a field (`…_notes`)."""
    found: set[str] = set()
    waiting: list[ast.AST] = [ast.parse((ROOT / file).read_text())]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef) and node.name.endswith("_notes"):
            continue
        if isinstance(node, ast.Attribute):
            found.add(node.attr)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
        waiting.extend(ast.iter_child_nodes(node))
    return frozenset(found)


def test_every_field_of_the_schema_has_a_reader_or_is_told_about() -> None:
    known = READER_OF.keys() | TOLD.keys() | REFUSED | SELECTED | {"pool.maxParticipantsPerHost"}
    assert PYTHON_NAMES.keys() - known == set(), "name the code that acts on it, or tell the user that none does"
    assert known - PYTHON_NAMES.keys() == set(), "no field of that name any more"


@pytest.mark.parametrize("path", sorted(READER_OF))
def test_the_reader_of_a_field_reads_it(path: str) -> None:
    name = PYTHON_NAMES[path]
    whole = path.rpartition(".")[0].rpartition(".")[2] in ("qos", "requestedQos")  # compared as a whole
    wanted = {"model_dump"} if whole else {name, path.rpartition(".")[2]}
    assert names_read(READER_OF[path]) & wanted, f"{READER_OF[path]} reads no {name}"


def test_a_field_that_the_api_server_selects_by_is_declared_so() -> None:
    assert {f".spec.{path.partition('.')[2]}" for path in SELECTED} <= {*RobotAppInstance.CRD.selectable}


@pytest.mark.parametrize("path", sorted(TOLD))
def test_a_field_without_effect_is_named_to_who_sets_it(path: str) -> None:
    spec = dict(TOLD[path])
    parts = spec.pop("components", ())
    notes = " ".join(notes_of(make_app(*parts, **spec)))
    assert path.rpartition(".")[2] in notes, notes


def test_the_apps_of_a_pool_with_a_limit_of_its_own_are_told_that_it_does_nothing_yet() -> None:
    assert notes_of(make_app(), make_pool()) == ()
    (note,) = notes_of(make_app(), make_pool(maxParticipantsPerHost=DEFAULT_PARTICIPANTS - 1))
    assert "spec.maxParticipantsPerHost 49 has no effect yet" in note


def make_pool(**spec: Any) -> Pool:
    return msgspec.convert({"metadata": {"name": "default"}, "spec": spec}, Pool)
