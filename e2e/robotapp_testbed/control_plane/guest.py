"""A cluster of the user's own (kind, k3s …) where our programs and a few simulated nodes are guests for a while.

with GuestPlane(Path("kubeconfig")) as cp:
    product.install(cp)

Nothing that exists there is touched: what would collide is refused before the first write. What the guest creates is
removed at the end; after a kill -9 `remove(kubeconfig)` does it, which recognises the guest by a label of its namespace.
"""

import base64
import json
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from robotapp_api.model.names import API_VERSION, SYSTEM_NAMESPACE
from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.control_plane import components, identity, servers
from robotapp_testbed.control_plane.api import Api
from robotapp_testbed.control_plane.commands import as_input
from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.control_plane.servers import Program
from robotapp_testbed.failures import ApiStatusError, CommandError, TestbedError
from robotapp_testbed.processes.process import wait_until

GUEST_LABEL: Final = "robotics.io/guest"
"""On the namespace, the rights and the nodes of a guest; also the key of the taint that keeps others off its nodes."""
TAINT: Final[Mapping[str, str]] = {"key": GUEST_LABEL, "value": "simulated", "effect": "NoSchedule"}
TOLERATION: Final[Mapping[str, str]] = {"key": GUEST_LABEL, "operator": "Exists"}
_ACCOUNT: Final = "robotapp-guest"
_ACCESS_LIFE = "24h"
_COMMAND_S = 120.0
_COLLECTED_S = 90.0
_PART = "app.kubernetes.io/part-of=robotapp"
_CRDS = ("robotapps", "robotappinstances", "robotclaims", "domainpools", "nodetelemetries")
_CHART_KINDS = "validatingadmissionpolicybindings,validatingadmissionpolicies,clusterrolebindings,clusterroles"


class GuestPlane(ControlPlane):
    """The user's cluster with the interface of ControlPlane; it has no processes of its own but kwok.

    `kubeconfig`'s current context decides which cluster; its user needs cluster-admin. `nodes` are the names of the
    simulated nodes that will be added and `namespaces` those that will be created: both must not exist yet.
    """

    def __init__(
        self,
        kubeconfig: Path,
        *,
        nodes: Iterable[str],
        namespaces: Iterable[str],
        assets: Assets | None = None,
    ) -> None:
        super().__init__(kwok=True, assets=assets)
        self._wanted = [Program.KWOK]
        self._own = OwnKubectl(kubeconfig, assets=assets)
        self._nodes = tuple(nodes)
        self._namespaces = (SYSTEM_NAMESPACE, *namespaces)
        self._is_guest = False

    @property
    def has_controllers(self) -> bool:
        return True

    def kubeconfig(self, name: str = identity.ADMIN) -> Path:
        """That of `admin`, or of a ServiceAccount of the installed chart (`operator`, `scheduler`)."""
        path = self._started().kubeconfig(name)
        if not path.exists():
            account = {"operator": identity.OPERATOR_ACCOUNT, "scheduler": identity.SCHEDULER_ACCOUNT}[name]
            self._write_kubeconfig(name, account)
        return path

    def learn_new_kinds(self) -> None:
        """Wait until the garbage collector knows RobotApps (it looks for new kinds every 30 s)."""
        apps = f"/apis/{API_VERSION}/namespaces/{SYSTEM_NAMESPACE}/robotapps"
        maps = f"/api/v1/namespaces/{SYSTEM_NAMESPACE}/configmaps"
        component = {"name": "probe", "image": "registry.invalid/probe:1"}
        app = {"apiVersion": API_VERSION, "kind": "RobotApp", "metadata": {"name": "kinds-known"}}
        spec = {"suspend": True, "ros": {"distro": "humble"}, "components": [component]}
        owner = self.api.create(apps, {**app, "spec": spec})
        reference = {"apiVersion": API_VERSION, "kind": "RobotApp", "name": "kinds-known"}
        reference["uid"] = owner["metadata"]["uid"]
        self.api.create(maps, {"metadata": {"name": "kinds-known", "ownerReferences": [reference]}})
        self.api.delete(f"{apps}/kinds-known")
        if not wait_until(lambda: not self._exists(f"{maps}/kinds-known"), timeout_s=_COLLECTED_S, poll_s=0.5):
            raise TestbedError(f"the cluster's garbage collector did not notice our kinds in {_COLLECTED_S:.0f} s")

    def close(self) -> None:
        """Remove what was added, while kwok still ends the pods of its nodes, then end our processes."""
        for process in list(self._processes.values()):
            if process.name != Program.KWOK:
                process.kill()
        try:
            if self._is_guest:
                self._own.remove(self._namespaces)
        finally:
            super().close()

    # --- inside -----------------------------------------------------------------------------------------------

    def _make_layout(self, run_dir: Path) -> components.Layout:
        return components.Layout.create(run_dir, server_url=self._own.cluster()["server"])

    def _write_files(self, layout: components.Layout, binaries: Mapping[str, Path]) -> None:
        for name, path in binaries.items():
            (layout.bin_dir / name).symlink_to(path.resolve())
        authority = self._own.cluster().get("certificate-authority-data", "")
        if not authority:
            raise TestbedError(f"{self._own.kubeconfig} names no certificate authority for its cluster")
        layout.ca_file.write_bytes(base64.b64decode(authority))
        self._own.refuse_collisions(nodes=self._nodes, namespaces=self._namespaces)
        self._is_guest = True
        self._own.run("create", "-f", "-", stdin=_rights())
        self._write_kubeconfig(identity.ADMIN, _ACCOUNT)
        layout.kubeconfig(Program.KWOK).symlink_to(layout.kubeconfig(identity.ADMIN))

    def _start_servers(self, layout: components.Layout, binaries: Mapping[str, Path]) -> None:
        token = self._identities[identity.ADMIN].token
        self._api = Api(layout.server_url, ca_file=layout.ca_file, token=token)
        settings = components.Settings(own_cluster=False)
        build = servers.Builder(layout, settings, binaries, self._api)
        self._processes = build.clients([Program.KWOK], scheduler_config=False)
        for process in self._processes.values():
            process.wait_ready()

    def _write_kubeconfig(self, name: str, account: str) -> None:
        layout = self._started()
        token = self._own.run(
            "create", "token", account, "-n", SYSTEM_NAMESPACE, f"--duration={_ACCESS_LIFE}"
        ).strip()  # dies with its ServiceAccount, so at the latest at the end
        namespace = "default" if name == identity.ADMIN else SYSTEM_NAMESPACE
        user = identity.Identity(user=account, token=token, namespace=namespace)
        self._identities[name] = user
        path = layout.kubeconfig(name)
        path.touch(mode=0o600)
        path.write_text(identity.kubeconfig(user, server_url=layout.server_url, ca_file=layout.ca_file))

    def _exists(self, path: str) -> bool:
        try:
            self.api.get(path)
        except ApiStatusError as error:
            if error.status == 404:
                return False
            raise
        return True


class OwnKubectl:
    """kubectl as the user runs it: their environment, so that every way to sign in works."""

    def __init__(self, kubeconfig: Path, *, assets: Assets | None = None) -> None:
        if not kubeconfig.is_file():
            raise TestbedError(f"there is no kubeconfig {kubeconfig}")
        self.kubeconfig = kubeconfig.absolute()
        self._assets = assets or Assets()
        self._cluster: dict[str, str] | None = None

    def run(self, *args: str, stdin: object = None) -> str:
        """Standard output; CommandError when it fails."""
        kubectl = self._assets.resolve(["kubectl"])["kubectl"]
        command = [str(kubectl), f"--kubeconfig={self.kubeconfig}", *args]
        done = subprocess.run(
            command, input=as_input(stdin), capture_output=True, text=True, timeout=_COMMAND_S, check=False
        )
        if done.returncode != 0:
            raise CommandError(["kubectl", *args], done.returncode, done.stdout, done.stderr)
        return done.stdout

    def cluster(self) -> dict[str, str]:
        """`server` and `certificate-authority-data` of the current context."""
        if self._cluster is None:
            view = json.loads(self.run("config", "view", "--minify", "--flatten", "--raw", "-o", "json"))
            self._cluster = view["clusters"][0]["cluster"]
        return self._cluster

    def refuse_collisions(self, *, nodes: Sequence[str], namespaces: Sequence[str]) -> None:
        """TestbedError when something of ours, or with our names, is there already."""
        wanted = [f"customresourcedefinition/{plural}.robotics.io" for plural in _CRDS]
        wanted += [f"namespace/{name}" for name in namespaces] + [f"node/{name}" for name in nodes]
        present = self.run("get", "--ignore-not-found", "-o", "name", *wanted).split()
        if not present:
            return
        cure = "It would change what is there. Use another cluster"
        if self.is_guest():
            cure = "An earlier run was killed before it could clean up. End it with --down"
        raise TestbedError(f"the cluster of {self.kubeconfig} already has {', '.join(present)}. {cure}.")

    def is_guest(self) -> bool:
        """Whether a guest (of this run or a killed one) is in the cluster."""
        return bool(self.run("get", "namespaces", "-l", GUEST_LABEL, "-o", "name").strip())

    def remove(self, namespaces: Sequence[str]) -> None:
        """Remove everything of the guest. Namespaces go first: kwok must still end the pods in them."""
        gone = ("--ignore-not-found", "--timeout=90s")
        self.run("delete", "namespace", *(name for name in namespaces if name != SYSTEM_NAMESPACE), *gone)
        self.run("delete", "nodes", "-l", GUEST_LABEL, *gone)
        self.run("delete", "crd", *(f"{plural}.robotics.io" for plural in _CRDS), *gone)
        self.run("delete", _CHART_KINDS, "-l", _PART, *gone)
        self.run("delete", "rolebindings,roles", "--all-namespaces", "-l", _PART, *gone)
        self.run("delete", "clusterrolebinding", "-l", GUEST_LABEL, *gone)
        self.run("delete", "namespace", SYSTEM_NAMESPACE, *gone)


def remove(kubeconfig: Path, *, namespaces: Iterable[str]) -> bool:
    """Clean up after a guest that was killed; False when there is none."""
    own = OwnKubectl(kubeconfig)
    if not own.is_guest():
        return False
    names = tuple(namespaces)
    own.run("delete", "namespace", *names, "--ignore-not-found", "--wait=false")
    for name in names:  # their kubelets were simulated by a kwok that is gone: nobody else would end them
        own.run("delete", "pods", "-n", name, "--all", "--force", "--grace-period=0")
    own.remove(names)
    return True


def _rights() -> list[dict[str, Any]]:
    labels = {GUEST_LABEL: "true"}
    account = {"kind": "ServiceAccount", "name": _ACCOUNT, "namespace": SYSTEM_NAMESPACE}
    return [
        {"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": SYSTEM_NAMESPACE, "labels": labels}},
        {
            "apiVersion": "v1",
            "kind": "ServiceAccount",
            "metadata": {"name": _ACCOUNT, "namespace": SYSTEM_NAMESPACE, "labels": labels},
        },
        {
            "apiVersion": "rbac.authorization.k8s.io/v1",
            "kind": "ClusterRoleBinding",
            "metadata": {"name": _ACCOUNT, "labels": labels},
            "roleRef": {"apiGroup": "rbac.authorization.k8s.io", "kind": "ClusterRole", "name": "cluster-admin"},
            "subjects": [account],
        },
    ]
