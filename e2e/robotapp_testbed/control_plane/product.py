"""Our product on a testbed: its rights and policies from the chart, its programs as local processes.

A local operator or scheduler uses the identity its pod would have, so RBAC and admission policies decide as in production.
"""

import os
import sys
import time
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import Any, Final

import yaml

from robotapp_api.model.names import API_VERSION, SYSTEM_NAMESPACE, Annotation
from robotapp_testbed.binaries.pins import REPOSITORY
from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.control_plane.servers import answers
from robotapp_testbed.failures import ApiStatusError, CommandError, TestbedError
from robotapp_testbed.processes import as_in_image, ports
from robotapp_testbed.processes.process import Process, wait_until

CHART = REPOSITORY / "helm" / "robotapp"
CRDS = REPOSITORY / "crds"
SCHEDULER_CONFIG: Final = "robotapp-scheduler"
"""The ConfigMap of the chart that a scheduler started with `config_map=` follows."""
LAST_GOOD_CONFIG: Final = "robotapp-scheduler-last-good"
_WORKLOADS = frozenset({"Deployment", "DaemonSet", "StatefulSet", "Job", "CronJob", "PodDisruptionBudget", "Pod"})
REGISTRY = "registry.example"
"""Stands before the images of workloads, which nothing pulls here."""
_FIRST = ("Namespace", "CustomResourceDefinition")
_KEPT = "Secret"
"""Of a kind whose content the chart makes once: without a cluster to look at, each rendering has another."""
_CRD_PATH = "/apis/apiextensions.k8s.io/v1/customresourcedefinitions"
_MANAGER = "robotapp-testbed"
_PROCESS_READY_S = 90.0
_POLICIES_S = 90.0
_ESTABLISHED_S = 90.0
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def install(cp: ControlPlane, *, values: Mapping[str, Any] | None = None) -> None:
    """Apply what the chart installs except its workloads: CRDs, default pool, RBAC, policies, configuration. May be repeated.

    `values` are chart values. A tree without a chart gets the CRDs alone. One namespace may hold all ids unless a quota is given:
    most that runs here has only one.
    """
    objects = _rendered(cp, _without_quota(values or {})) if (CHART / "Chart.yaml").exists() else []
    objects = [*_crds(objects), *objects]
    define(cp, [_namespace(), *(obj for obj in objects if obj["kind"] in _FIRST)])
    _apply(cp, [obj for obj in objects if obj["kind"] not in _FIRST and not _is_kept(cp, obj)])
    if any(obj["kind"] == "ValidatingAdmissionPolicyBinding" for obj in objects):
        _wait_for_policies(cp)


def _without_quota(values: Mapping[str, Any]) -> dict[str, Any]:
    pool = values.get("domainPool", {})
    return {**values, "domainPool": {**pool, "quota": {"default": None, **pool.get("quota", {})}}}


def apply_workloads(cp: ControlPlane, *, values: Mapping[str, Any], kinds: AbstractSet[str] = _WORKLOADS) -> None:
    """The chart's Deployments, its DaemonSet and what belongs to them, which `install` leaves out; for nodes that run containers."""
    _apply(cp, [obj for obj in _template(cp, values) if obj["kind"] in kinds])


def define(cp: ControlPlane, objects: Sequence[Mapping[str, Any]]) -> None:
    """Apply CRDs (and namespaces) and wait until their kinds are served and their deletions noticed."""
    names = [obj["metadata"]["name"] for obj in objects if obj["kind"] == "CustomResourceDefinition"]
    present = {item["metadata"]["name"] for item in cp.api.get(_CRD_PATH)["items"]}
    _apply(cp, objects)
    if names:
        _wait_established(cp, names)
        _wait_listed(cp, frozenset(names))
    if not present.issuperset(names):
        cp.learn_new_kinds()


def _wait_established(cp: ControlPlane, names: Sequence[str]) -> None:
    deadline_s = time.monotonic() + _ESTABLISHED_S
    while True:
        try:
            cp.kubectl("wait", "--for=condition=Established", f"--timeout={_ESTABLISHED_S:g}s", "crd", *names)
        except CommandError as error:
            # kubectl gives up at once on a CRD the server has not written a status to yet.
            if "accessor error" not in error.stderr or time.monotonic() > deadline_s:
                raise
            time.sleep(0.1)
        else:
            return


def _wait_listed(cp: ControlPlane, names: AbstractSet[str]) -> None:
    """Wait until discovery lists the CRDs' kinds, which lags behind Established, and leave kubectl's cache with all of them.

    kubectl reads an incomplete cache again for a kind it misses, but expands short names from the old one.
    """
    deadline_s = time.monotonic() + _ESTABLISHED_S
    groups = {name.partition(".")[2] for name in names}
    while missing := sorted(names - _listed(cp, groups)):
        if time.monotonic() > deadline_s:
            raise TestbedError(
                f"discovery lists no {', '.join(missing)} {_ESTABLISHED_S:g} s after they were established"
            )
        time.sleep(0.1)


def _listed(cp: ControlPlane, groups: AbstractSet[str]) -> set[str]:
    """`plural.group`, which is a CRD's name, of what discovery has now: this command alone reads no cache."""
    return {
        line
        for group in groups
        for line in cp.kubectl("api-resources", "-o", "name", f"--api-group={group}").splitlines()
    }


def start_operator(
    cp: ControlPlane,
    *,
    name: str = "operator",
    wait: bool = True,
    env: Mapping[str, str] | None = None,
    program: Sequence[str] = (),
    host_access: bool = True,
    **flags: object,
) -> Process:
    """`python -m robotapp_operator` as the operator's identity. `sweep_seconds=1` becomes `--sweep-seconds 1`, True a bare flag.

    `program`: another module, with arguments of its own, that runs the operator; it gets the usual ones behind them.
    `host_access`: as in the chart, whose policy `install` has applied; by environment, for older versions have no such flag.
    """
    command = [as_in_image.__file__, *program, "robotapp_operator"]
    env = {**({"ROBOTAPP_OPERATOR_HOST_ACCESS": "1"} if host_access else {}), **(env or {})}
    return _start(cp, command, identity="operator", name=name, wait=wait, flags=flags, env=env)


def start_scheduler(
    cp: ControlPlane,
    config: Path | None = None,
    *,
    name: str = "scheduler",
    wait: bool = True,
    env: Mapping[str, str] | None = None,
    program: Sequence[str] = (),
    **flags: object,
) -> Process:
    """`python -m robotapp_scheduler` as the scheduler's identity; `env` comes on top of ours, `program` as for the operator."""
    extra = {"config": config} if config else {}
    command = ["-m", *program, "robotapp_scheduler"]
    return _start(cp, command, identity="scheduler", name=name, wait=wait, flags={**extra, **flags}, env=env)


def arguments(flags: Mapping[str, object]) -> list[str]:
    """Keyword arguments as command-line flags; None and False are left out."""
    args: list[str] = []
    for name, value in flags.items():
        flag = "--" + name.replace("_", "-")
        if value is True:
            args.append(flag)
        elif value is not None and value is not False:
            args += [flag, str(value)]
    return args


def _start(
    cp: ControlPlane,
    command: Sequence[str],
    *,
    identity: str,
    name: str,
    wait: bool,
    flags: Mapping[str, object],
    env: Mapping[str, str] | None = None,
) -> Process:
    (port,) = ports.free_ports(1)
    own = {"kubeconfig": cp.kubeconfig(identity), "health_port": port}
    url = f"https://127.0.0.1:{port}"
    process = Process(
        name,
        [sys.executable, *command, *arguments({**own, **flags})],
        run_dir=cp.run_dir,
        log_path=cp.logs_dir / f"{name}.log",
        env={key: value for key, value in os.environ.items() if key != "KUBECONFIG"}
        | {"POD_NAME": name, **(env or {})},
        ready=lambda: answers(f"{url}/readyz"),
        ready_timeout_s=_PROCESS_READY_S,
        health_url=url,
    )
    cp.add_process(process).start()
    return process.wait_ready() if wait else process


def _wait_for_policies(cp: ControlPlane) -> None:
    """A policy decides about a second after it was stored: until then forgeries would pass, and a test with them."""
    pod = {
        "metadata": {"name": "probe", "annotations": {Annotation.GRANTED_DOMAIN: "0"}},
        "spec": {"containers": [{"name": "main", "image": "registry.invalid/main:1"}]},
    }
    instance = {
        "apiVersion": API_VERSION,
        "kind": "RobotAppInstance",
        "metadata": {"name": "probe"},
        "spec": {"app": "probe", "appUID": "probe"},
    }
    forged: dict[str, Mapping[str, Any]] = {
        "/api/v1/namespaces/default/pods": pod,
        f"/apis/{API_VERSION}/namespaces/default/robotappinstances": instance,
    }

    def refused() -> bool:
        return all(_refused_by_policy(cp, path, obj) for path, obj in forged.items())

    if not wait_until(refused, timeout_s=_POLICIES_S, poll_s=0.1):
        raise TestbedError(
            f"the chart's policies are stored but do not decide after {_POLICIES_S:.0f} s, see {cp.logs_dir}"
        )


def _refused_by_policy(cp: ControlPlane, path: str, obj: Mapping[str, Any]) -> bool:
    try:
        cp.api.create(f"{path}?dryRun=All", obj)
    except ApiStatusError as error:
        return "ValidatingAdmissionPolicy" in error.message
    return False


def _namespace() -> dict[str, Any]:
    return {"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": SYSTEM_NAMESPACE}}


def _rendered(cp: ControlPlane, values: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [obj for obj in _template(cp, values) if obj["kind"] not in _WORKLOADS]


def _template(cp: ControlPlane, values: Mapping[str, Any]) -> list[dict[str, Any]]:
    """All objects `helm install` creates."""
    text = cp.helm(
        "template",
        "robotapp",
        str(CHART),
        f"--namespace={SYSTEM_NAMESPACE}",
        "--include-crds",
        # Where the CRD exists the default pool is an ordinary object instead of a hook, which we would leave out.
        "--api-versions=robotics.io/v1alpha1/DomainPool",
        "--values=-",
        stdin=yaml.safe_dump({"imageRegistry": REGISTRY, **values}),
    )
    return [obj for obj in objects_of(text) if _is_installed(obj)]


def objects_of(text: str) -> list[dict[str, Any]]:
    """The objects of a stream of YAML documents. With libyaml, where PyYAML has it: ten times as fast for our CRDs."""
    return [obj for obj in yaml.load_all(text, Loader=_LOADER) if obj]


def _is_installed(obj: Mapping[str, Any]) -> bool:
    """Whether `helm install` creates the object: always, unless it is a hook for another moment."""
    hook = obj["metadata"].get("annotations", {}).get("helm.sh/hook", "post-install")
    return "install" in hook


def _is_kept(cp: ControlPlane, obj: Mapping[str, Any]) -> bool:
    if obj["kind"] != _KEPT:
        return False
    where = f"/api/v1/namespaces/{obj['metadata']['namespace']}/secrets"
    return any(item["metadata"]["name"] == obj["metadata"]["name"] for item in cp.api.get(where)["items"])


def _crds(rendered: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The generated CRD files the chart does not bring itself."""
    present = {obj["metadata"]["name"] for obj in rendered if obj["kind"] == "CustomResourceDefinition"}
    files = [obj for path in sorted(CRDS.glob("*.yaml")) for obj in objects_of(path.read_text())]
    return [obj for obj in files if obj["metadata"]["name"] not in present]


def _apply(cp: ControlPlane, objects: Sequence[Mapping[str, Any]]) -> None:
    """Without --namespace: the chart states each object's own, and with watched namespaces these are several."""
    if objects:
        cp.kubectl(
            "apply",
            "--server-side",
            "--force-conflicts",
            f"--field-manager={_MANAGER}",
            "-f",
            "-",
            stdin=list(objects),
        )
