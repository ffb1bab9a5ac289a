"""One service of a compose file to one component: the table of its fields."""

from collections.abc import Callable
from typing import Final

from robotapp_cli.importing.files.parts import Part
from robotapp_cli.importing.files.project import EXTENSION
from robotapp_cli.importing.services import devices, host, operation, program, storage
from robotapp_cli.importing.services.draft import Context, Draft, report_fields
from robotapp_cli.lint.findings import shown

Handler = Callable[[Draft, Part], None]

HANDLERS: Final[dict[str, Handler]] = {
    "entrypoint": program.take_entrypoint,
    "command": program.take_command,
    "working_dir": program.take_working_dir,
    "env_file": program.take_env_file,
    "environment": program.take_environment,
    "user": program.take_user,
    "group_add": host.take_group_add,
    "stdin_open": program.take_switch,
    "tty": program.take_switch,
    "pull_policy": program.take_pull_policy,
    "platform": program.take_platform,
    "restart": program.take_restart,
    "stop_signal": program.take_stop_signal,
    "stop_grace_period": program.take_stop_grace_period,
    "network_mode": host.take_network_mode,
    "ipc": host.take_ipc,
    "pid": host.take_pid,
    "privileged": host.take_privileged,
    "cap_add": host.take_capabilities,
    "cap_drop": host.take_capabilities,
    "security_opt": host.take_security_opt,
    "read_only": host.take_read_only,
    "sysctls": host.take_sysctls,
    "ulimits": host.take_ulimits,
    "shm_size": host.take_shm_size,
    "ports": host.take_ports,
    "expose": host.take_expose,
    "extra_hosts": host.take_extra_hosts,
    "dns": host.take_dns,
    "dns_search": host.take_dns,
    "dns_opt": host.take_dns,
    "hostname": host.take_hostname,
    "networks": host.take_networks,
    "volumes": storage.take_volumes,
    "tmpfs": storage.take_tmpfs,
    "configs": storage.take_configs,
    "secrets": storage.take_secrets,
    "devices": devices.take_devices,
    "gpus": devices.take_gpus,
    "runtime": devices.take_runtime,
    "depends_on": operation.take_depends_on,
    "healthcheck": operation.take_healthcheck,
    "deploy": operation.take_deploy,
    "cpus": operation.take_cpus,
    "mem_limit": operation.take_memory,
    "mem_reservation": operation.take_memory,
    "scale": operation.take_replicas,
    "labels": operation.take_labels,
    "annotations": operation.take_labels,
}
"""What takes each field, in the order in which fields are looked at."""

_ELSEWHERE: Final = frozenset({"image", "build", "profiles", EXTENSION})
_CPU: Final = "write resources.limits.cpu; shares and periods follow from it"
_KUBELET: Final = "the kubelet decides it"
_HOOK: Final = "write lifecycle.postStart or lifecycle.preStop with the command"
REASONS: Final = {
    "attach": "logs are read with kubectl robotapp logs",
    "blkio_config": "Kubernetes does not limit reading and writing",
    "cgroup": _KUBELET,
    "cgroup_parent": _KUBELET,
    "container_name": "pods have names of their own; the component has the name of the service",
    "cpu_count": _CPU,
    "cpu_percent": _CPU,
    "cpu_period": _CPU,
    "cpu_quota": _CPU,
    "cpu_rt_period": _CPU,
    "cpu_rt_runtime": _CPU,
    "cpu_shares": _CPU,
    "cpuset": "the kubelet's CPU manager gives cores of its own to pods with whole CPUs as requests and limits",
    "credential_spec": "only Windows has it",
    "develop": "nothing is built or synchronized in a cluster; build a new image",
    "device_cgroup_rules": "write devices of the component, or privileged: true, with which every device opens",
    "domainname": "write template.spec.dnsConfig.searches",
    "driver_opts": "a Service has no driver",
    "external_links": "all pods reach each other by the names of Services",
    "init": "write shareProcessNamespace: true under template.spec, with which the pod's pause process reaps zombies",
    "isolation": "only Windows has it",
    "label_file": "write the labels under template.metadata.labels",
    "links": "all pods reach each other by the names of Services (kubectl get services)",
    "logging": "the container runtime keeps logs; kubectl robotapp logs reads them",
    "mac_address": "the network plug-in of the cluster decides it",
    "mem_swappiness": _KUBELET,
    "memswap_limit": _KUBELET,
    "models": "name the model's server by an environment variable",
    "oom_kill_disable": "a container above its memory limit ends; write a higher limit",
    "oom_score_adj": "it follows from requests and limits",
    "pids_limit": "the kubelet limits processes (podPidsLimit)",
    "post_start": _HOOK,
    "pre_stop": _HOOK,
    "provider": "what it provides is no container; name it by an environment variable",
    "storage_opt": "write resources.limits.ephemeral-storage",
    "use_api_socket": "nodes of a cluster have no docker",
    "userns_mode": "pods of an app have the users of the node",
    "uts": "with hostNetwork the host name is the node's",
    "volumes_from": "write the same volumes and volumeMounts for both components",
}
"""Why other fields of the compose specification are left out."""


def draft_component(context: Context, name: str, service: Part) -> Draft:
    """Returns the component that a service becomes, and reports every field of the service."""
    fields = service.as_fields()
    draft = Draft(context.components[name], service, context)
    program.take_image(draft)
    for key, handler in HANDLERS.items():
        part = fields.get(key)
        if part is None:
            continue
        if part.is_empty:
            context.report.omit(part, "nothing is written here")
        else:
            handler(draft, part)
    for key in ("image", "build", "profiles"):
        if (part := fields.get(key)) is not None and part.is_empty:
            context.report.omit(part, "nothing is written here")
    program.finish_environment(draft)
    report_fields(draft, service, frozenset({*HANDLERS, *_ELSEWHERE}), REASONS)
    return draft


def report_silent(draft: Draft) -> None:
    """Reports every value of the service that no line is about yet, so that nothing is lost without a line."""
    service, start = draft.service, shown(draft.service.path)
    reported_paths = {line.path for line in draft.report.lines if line.path.startswith(start)}
    outer_paths = {text[:end] for text in reported_paths for end in range(len(text)) if text[end] in ".["}
    remaining_parts = list((service.fields or {}).values())
    while remaining_parts:
        part = remaining_parts.pop(0)
        text = shown(part.path)
        if text in reported_paths:
            continue
        if text in outer_paths:
            remaining_parts += [*(part.fields or {}).values(), *(part.items or [])]
        else:
            draft.report.omit(
                part, "nothing is written here" if part.is_empty else "no field of a component stands for it"
            )
