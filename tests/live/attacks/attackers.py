"""The attackers with their rights on a live control plane, and one attempt of an attack."""

import copy
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import yaml
from tests.live.attacks import agent_tokens
from tests.live.attacks.table import kinds
from tests.live.attacks.table.attack import Attack, Json, Road, merge_patch
from tests.live.attacks.table.devices import ATTACKED, SLICES
from tests.live.attacks.table.stolen_agents import NODE, OTHER

from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.api import APPLY, MERGE, Api
from robotapp_testbed.control_plane.namespaces import created
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines import topology
from robotapp_testbed.machines.nodes import robot
from robotapp_testbed.machines.telemetry import create

_POLICIES_S = 90.0
_VENDOR = "attacking-vendor"
"""ClusterRole and account of another driver."""
_RIGHTS = {
    "clerk": ["--verb=*", "--resource=robotapps.robotics.io"],
    "deputy": ["--verb=*", "--resource=*.robotics.io"],
}


@dataclass(frozen=True, slots=True)
class Attackers:
    """`apis`: by the attacker's name; `namespaces`: by the words of `Attack.where`."""

    admin: Api
    apis: Mapping[str, Api]
    namespaces: Mapping[str, str]

    def attempt(
        self, attack: Attack, road: Road, *, who: str = "", validation: str = "Strict", suffix: str = ""
    ) -> Json:
        """The stored object if the write went through; ApiStatusError if it was refused."""
        attacker, kind = self.apis[who or attack.who], attack.kind
        namespace = self.namespaces.get(attack.where, attack.where)
        name = attack.name or f"{attack.key}-{road.name.lower().replace('_', '-')}{suffix}"
        query = f"?fieldValidation={validation}"
        honest = _named(attack, name, namespace)
        path = kind.path(namespace, name, attack.subresource)
        if road is Road.CREATE:
            result = attacker.create(f"{kind.path(namespace)}{query}", attack.changed(honest))
        elif road is Road.APPLY:
            result = _apply(attacker, f"{path}{query}", attack.changed(honest))
        else:
            stored = self._stored(attack, honest, path, kind.path(namespace))
            if road is Road.UPDATE:
                result = attacker.request("PUT", f"{path}{query}", attack.changed(stored))
            elif road is Road.PATCH:
                patch = merge_patch(stored, attack.changed(stored))
                result = attacker.patch(f"{path}{query}", patch, content_type=MERGE)
            else:
                result = _apply(attacker, f"{path}{query}", attack.changed(honest))
        return dict(result)

    def _stored(self, attack: Attack, honest: Json, path: str, collection: str) -> Json:
        """The honest object in the API server, made by the admin. What has a name of its own is refused unseen or is there."""
        if attack.there:
            return dict(self.admin.get(path))
        return honest if attack.name else dict(self.admin.create(collection, honest))


def _named(attack: Attack, name: str, namespace: str) -> Json:
    honest = copy.deepcopy(attack.good)
    metadata = honest.setdefault("metadata", {})
    metadata["name"] = name
    if attack.kind.namespaced:
        metadata["namespace"] = namespace
    return {"apiVersion": attack.kind.version, "kind": attack.kind.kind} | honest


def _apply(attacker: Api, path: str, obj: Json) -> Json:
    return dict(attacker.patch(f"{path}&fieldManager=attacker&force=true", obj, content_type=APPLY))


@contextmanager
def attacked(plane: ControlPlane, own: str, victim: str) -> Iterator[Attackers]:
    """Two namespaces; `tenant` is admin of the first, where clerk and deputy are ServiceAccounts. Two nodes with telemetry."""
    with created(plane, own), created(plane, victim), _nodes(plane) as agent, _vendor(plane, own) as vendor:
        plane.kubectl("create", "rolebinding", "tenant", "--clusterrole=admin", "--user=tenant", "-n", own)
        tokens = {name: _token(plane, name) for name in ("tenant", "operator", "scheduler", "labeller")}
        tokens |= {"agent": agent, "vendor": vendor}
        for name, rights in _RIGHTS.items():
            plane.kubectl("create", "serviceaccount", name, "-n", own)
            plane.kubectl("create", "role", name, *rights, "-n", own)
            plane.kubectl("create", "rolebinding", name, f"--role={name}", f"--serviceaccount={own}:{name}", "-n", own)
            tokens[name] = plane.kubectl("create", "token", name, "-n", own).strip()
        plane.kubectl("create", "serviceaccount", "editor", "-n", own)
        role = ("--clusterrole=robotapp-editor", f"--serviceaccount={own}:editor")
        plane.kubectl("create", "rolebinding", "editor", *role, "-n", own)
        tokens["editor"] = plane.kubectl("create", "token", "editor", "-n", own).strip()
        apis = {name: Api(plane.server_url, ca_file=plane.ca_file, token=token) for name, token in tokens.items()}
        kubelet = {"Impersonate-User": f"system:node:{NODE}", "Impersonate-Group": "system:nodes"}
        apis["kubelet"] = Api(plane.server_url, ca_file=plane.ca_file, token=_token(plane, "admin"), headers=kubelet)
        namespaces = {"own": own, "victim": victim, "system": "robotapp-system"}
        attackers = Attackers(plane.api, apis, namespaces)
        try:
            _await_policies(attackers)
            yield attackers
        finally:
            for api in apis.values():
                api.close()


@contextmanager
def _nodes(plane: ControlPlane) -> Iterator[str]:
    """The token of the agent on the first of two nodes."""
    nodes = [robot(NODE), robot(OTHER)]
    topology.apply(plane, nodes)
    try:
        for node in nodes:
            create(plane, node.name, uid="", labels={})
        yield agent_tokens.bound_token(plane, NODE)
    finally:
        agent_tokens.remove(plane, NODE)
        topology.remove(plane, nodes)


@contextmanager
def _vendor(plane: ControlPlane, namespace: str) -> Iterator[str]:
    """The token of another driver, which may write ResourceSlices of all nodes."""
    plane.kubectl("create", "serviceaccount", _VENDOR, "-n", namespace)
    plane.kubectl("create", "clusterrole", _VENDOR, "--verb=*", "--resource=resourceslices.resource.k8s.io")
    account = f"--serviceaccount={namespace}:{_VENDOR}"
    plane.kubectl("create", "clusterrolebinding", _VENDOR, f"--clusterrole={_VENDOR}", account)
    try:
        yield plane.kubectl("create", "token", _VENDOR, "-n", namespace).strip()
    finally:
        plane.kubectl("delete", "clusterrolebinding,clusterrole", _VENDOR)
        plane.kubectl("delete", "resourceslices", "-l", f"{ATTACKED}=true")
        plane.kubectl("delete", "deviceclasses,devicetaintrules", "-l", f"{ATTACKED}=true")


def _token(plane: ControlPlane, name: str) -> str:
    loaded = yaml.safe_load(plane.kubeconfig(name).read_text())
    return str(loaded["users"][0]["user"]["token"])


def _await_policies(attackers: Attackers) -> None:
    """The API server compiles a new policy in the background; `product.install` cannot wait for those of RobotApps."""
    app = {"apiVersion": kinds.ROBOTAPP.version, "kind": kinds.ROBOTAPP.kind, "metadata": {"name": "probe"}}
    apps = kinds.ROBOTAPP.path(attackers.namespaces["own"])
    forged = SLICES[0].changed({**SLICES[0].good, "metadata": {"name": "probe"}})
    probes = {
        "references": ("clerk", apps, {**app, **kinds.templated(serviceAccountName="deployer")}),
        "host-access": ("clerk", apps, {**app, **kinds.templated(hostNetwork=True)}),
        "device-slices": (
            "kubelet",
            kinds.RESOURCE_SLICE.path(""),
            {"apiVersion": kinds.RESOURCE_SLICE.version, "kind": kinds.RESOURCE_SLICE.kind, **forged},
        ),
    }
    until = time.monotonic() + _POLICIES_S
    for name, (who, path, body) in probes.items():
        while not _is_refused(attackers.apis[who], f"{path}?dryRun=All", body):
            if time.monotonic() > until:
                raise TimeoutError(f"the policy robotapp-{name} did not decide within {_POLICIES_S:.0f} s")
            time.sleep(0.1)


def _is_refused(api: Api, path: str, body: Json) -> bool:
    try:
        api.create(path, body)
    except ApiStatusError as error:
        if "ValidatingAdmissionPolicy" in error.message:
            return True
        raise
    return False
