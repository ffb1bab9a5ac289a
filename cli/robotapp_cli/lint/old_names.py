"""Names that fields had before v1alpha1 was reshaped, or that ROS and other kinds of Kubernetes give them, and what to write.

Only for messages: nothing accepts them.
"""

from typing import Final

from robotapp_cli.lint.findings import Path, fields_only

_POD_FIELDS: Final = (
    "volumes",
    "imagePullSecrets",
    "initContainers",
    "tolerations",
    "nodeSelector",
    "priorityClassName",
    "serviceAccountName",
    "runtimeClassName",
    "terminationGracePeriodSeconds",
)
_COMPONENT: Final = "spec.components"
_MOST_NAMES: Final = 5
_HOST: Final = ("hostNetwork", "hostPID", "hostIPC")
_ON_JOB: Final = ("activeDeadlineSeconds", "backoffLimit")
_RUNS_THAT_END: Final = "docs/how-to/runs-that-end.md"
_JOB_SPEC: Final = {
    **dict.fromkeys(
        ("completions", "parallelism", "completionMode"),
        "remove it and write job: {} for a program that ends; runs with other values are spec.matrix (docs/how-to/sweeps.md), "
        "runs that are alike a Job of your own (docs/how-to/jobs-with-a-domain.md)",
    ),
    **dict.fromkeys(
        ("ttl", "ttlSecondsAfterFinished"),
        f"write completion: {{ttl: 1h}} in spec: it deletes the whole app one hour after its end ({_RUNS_THAT_END})",
    ),
    "maxRestarts": f"write completion: {{maxRestarts: 3}} in spec: all jobs run again when one has failed ({_RUNS_THAT_END})",
    **dict.fromkeys(
        ("schedule", "cron"),
        f'write schedule: {{cron: "0 2 * * *"}} beside job in the component ({_RUNS_THAT_END})',
    ),
}
"""Fields of Jobs and CronJobs that an app has at another place, or not at all → what to write."""
_CRON_JOB: Final = {
    "concurrencyPolicy": "remove it: due times while a run goes on are skipped",
    **dict.fromkeys(
        ("successfulJobsHistoryLimit", "failedJobsHistoryLimit"),
        "remove it: the Job of the last run stays until the next one begins",
    ),
}
"""Fields of CronJobs beside a schedule → what to do in place of them."""
_RESTART: Final = (
    "remove it: a program is started again when it ends, with job: {} in the component only when it fails, "
    f"as often as job.backoffLimit ({_RUNS_THAT_END})"
)
_OF_COMPOSE: Final = {
    "network_mode": "write template: {spec: {hostNetwork: true}} for host",
    "ipc": "write template: {spec: {hostIPC: true}} for host",
    "pid": "write template: {spec: {hostPID: true}} for host",
    "privileged": "write securityContext: {privileged: true}",
    "cap_add": "write securityContext: {capabilities: {add: [SYS_NICE]}}",
    "shm_size": "write sharedMemory: {size: 1Gi}",
    "ulimits": "no field of Kubernetes sets them; write a capability, or ulimit in a shell",
    "runtime": "write template.spec.runtimeClassName, and resources: {limits: {nvidia.com/gpu: 1}} for a GPU",
    "gpus": "write resources: {limits: {nvidia.com/gpu: 1}}",
}
_AFFINITY: Final = (
    "write nodeSelector, runsOn, requires, colocateWith or separateFrom; robots choose by matchExpressions, too"
)
_SERVICE: Final = (
    "write service: {spec: {ports: [{name: http, port: 80}]}} in the component (docs/how-to/reach-a-component.md)"
)

_EDGE: Final = "spec.edges"
_KINDS: Final = {"service": "Service", "action": "Action"}
"""Field that is often written in place of `topic` → the kind of edge that is meant."""

FIELDS: Final[dict[str, str]] = {
    "spec.dds": "write ros2",
    "spec.ros2.network": "remove it: every pod has a network of its own",
    "spec.robots.selector": "write nodeSelector",
    "spec.robots.instances": "write assignment",
    "spec.update.policy": "write operator",
    "spec.placement.allOrNothing": "write gang: All in place of true, gang: None in place of false",
    **{f"{_COMPONENT}.{name}": f"write template.spec.{name}" for name in _POD_FIELDS},
    **{
        f"{_COMPONENT}.{name}": f"write template: {{spec: {{{name}: true}}}} (docs/security.md#access-to-the-node)"
        for name in _HOST
    },
    **{f"{_COMPONENT}.{name}": f"{cure} (docs/how-to/reach-the-node.md)" for name, cure in _OF_COMPOSE.items()},
    **{f"{place}.affinity": _AFFINITY for place in (_COMPONENT, f"{_COMPONENT}.template.spec")},
    **{f"{_COMPONENT}.{name}": f"write job: {{{name}: …}}" for name in _ON_JOB},
    f"{_COMPONENT}.schedule.suspend": "write replicas: 0 in the component, or spec.suspend: true for the app",
    f"{_COMPONENT}.template.spec.activeDeadlineSeconds": "write job: {activeDeadlineSeconds: …} in the component",
    **{
        f"{place}.{name}": cure
        for name, cure in _JOB_SPEC.items()
        for place in ("spec", "spec.completion", _COMPONENT, f"{_COMPONENT}.job", f"{_COMPONENT}.template.spec")
        if (place, name) not in {("spec.completion", "ttl"), ("spec.completion", "maxRestarts")}
    },
    **{
        f"{place}.{name}": f"write schedule: {{cron: …, {name}: …}} beside job in the component"
        for name in ("timeZone", "startingDeadlineSeconds")
        for place in ("spec", _COMPONENT, f"{_COMPONENT}.job")
    },
    **{
        f"{place}.{name}": f"{cure} ({_RUNS_THAT_END})"
        for name, cure in _CRON_JOB.items()
        for place in ("spec", _COMPONENT, f"{_COMPONENT}.job", f"{_COMPONENT}.schedule")
    },
    **{f"{place}.restartPolicy": _RESTART for place in ("spec", _COMPONENT, f"{_COMPONENT}.job")},
    **{f"{place}.{name}": _SERVICE for name in ("services", "expose") for place in ("spec", _COMPONENT)},
    "spec.service": _SERVICE,
    f"{_COMPONENT}.service.port": "write spec: {ports: [{name: http, port: 80}]}",
    f"{_COMPONENT}.service.ports": "write spec: {ports: …}",
    f"{_COMPONENT}.service.type": "write spec: {type: …}",
    f"{_COMPONENT}.podSecurityContext": "write template.spec.securityContext",
    f"{_COMPONENT}.preStop": "write lifecycle.preStop",
    f"{_COMPONENT}.params": "write parameters: [{configMapKeyRef: {name, key}}]; $(ROBOTAPP_ROBOT) in key makes it one file per robot",
    f"{_COMPONENT}.lifecycle.managed": "remove it; ready: {lifecycle: Active} waits for a lifecycle node",
    f"{_COMPONENT}.ready.minHz": "write topic: {name, minRate}",
    **{
        f"{_COMPONENT}.ready.{check}": "write readinessProbe beside ready" for check in ("exec", "httpGet", "tcpSocket")
    },
    f"{_COMPONENT}.devices.match": "write usbID",
    f"{_COMPONENT}.devices.exclusive": "write sharing: Exclusive in place of true, sharing: Cluster in place of false",
    f"{_COMPONENT}.sharedData.claims": "write claimNames",
    f"{_EDGE}.name": "write topic",
    **{f"{_EDGE}.{name}": "write from" for name in ("publisher", "server")},
    **{f"{_EDGE}.{name}": "write to" for name in ("subscriber", "subscription", "client")},
}
"""Path without positions → what to write instead."""

VALUES: Final[dict[tuple[str, object], str]] = {
    (f"{_COMPONENT}.runsOn", "Any"): "leave runsOn out: absent means any tier",
    (f"{_COMPONENT}.runsOn", "Robot"): "write [Robot]",
    (f"{_COMPONENT}.runsOn", "Edge"): "write [Edge]",
    (f"{_COMPONENT}.runsOn", "Cloud"): "write [Cloud]",
    (
        "spec.placement.fallback.steps",
        "Onboard",
    ): "remove it and write runsOn: [Edge, Robot], which falls back on board",
}
"""Path without positions and a value that was once possible there."""


def of_field(path: Path) -> str:
    """What to write in place of a field that is gone; "" when there was none of that name."""
    return FIELDS.get(fields_only(path), "")


def of_edge(path: Path) -> str:
    """The kind of an edge that is named by a field of its own: Service for `service: /x`; "" for other fields."""
    return _KINDS.get(str(path[-1]), "") if fields_only(path[:-1]) == _EDGE else ""


def of_value(path: Path, value: object) -> str:
    """What to write in place of a value that is gone; "" when there was none."""
    where = fields_only(path)
    if where == f"{_COMPONENT}.ready.topic" and isinstance(value, str):
        return f"write topic: {{name: {value}}}"
    if where == f"{_EDGE}.latency" and isinstance(value, str):
        return f"write latency: {{budget: {value}}}"
    if where == "spec.robots" and isinstance(value, list) and all(isinstance(name, str) for name in value):
        names = ", ".join(value[:_MOST_NAMES])
        return f"write robots: {{nodeSelector: {{matchExpressions: [{{key: robotics.io/robot, operator: In, values: [{names}]}}]}}}}"
    return VALUES.get((where, value), "") if isinstance(value, str) else ""
