"""One real node: a box with containerd, a kubelet and kube-proxy, and the faults tests inject into it."""

import json
import os
import shutil
import socket
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines import fake_host
from robotapp_testbed.machines.doubles import Doubles
from robotapp_testbed.machines.nodes import Device
from robotapp_testbed.processes.process import wait_until
from robotapp_testbed.real import cgroups, prerequisites
from robotapp_testbed.real.box import Box, Inside, Plan
from robotapp_testbed.real.config import containerd, kubelet, network, services
from robotapp_testbed.real.config.addresses import Addresses
from robotapp_testbed.real.pings import Rtt, figures
from robotapp_testbed.real.scripts import sweep

_SERVES_S = 60.0
_CGROUP_FREE_S = 30.0
_PING_PAUSE_S = 0.05
_PING_ANSWER_S = 2


@dataclass(frozen=True)
class Surroundings:
    """What the cluster gives a node. Certificates and kubeconfigs are files of the run folder."""

    addresses: Addresses
    hub: Box
    run_dir: Path
    logs_dir: Path
    binaries: Mapping[str, Path]
    kubeconfig: Path
    proxy_kubeconfig: Path
    certificate: Path
    key: Path
    client_ca: Path
    images: Mapping[str, Path]
    """Archives by the name pods call them."""
    runtime: Path | None
    """Folder of a containerd of our own; without it the machine's is used."""
    plain_data: bool
    """Pods' frames go through the plain bridge of the hub; else somebody plugs the switch in."""


@dataclass(frozen=True, slots=True)
class Description:
    """What the node says of itself when it registers."""

    name: str
    labels: Mapping[str, str] = field(default_factory=dict)
    taints: Sequence[Mapping[str, str]] = ()
    devices: Sequence[Device] = ()
    """Of which it has doubles, in place of the machine's own; with none the machine's are there."""


class RealNode:
    """`index` numbers the nodes of a cluster from 1 and gives the addresses. `plug` joins a node that has come back."""

    def __init__(
        self,
        description: Description,
        index: int,
        surroundings: Surroundings,
        *,
        plug: Callable[["RealNode"], None] = lambda _: None,
    ) -> None:
        self.name = description.name
        self._description = description
        self._index = index
        self._plug = plug
        self._around = surroundings
        self._folder = surroundings.run_dir / "nodes" / self.name
        self._cgroup = surroundings.addresses.node_cgroup(self.name)
        devices = description.devices
        self._doubles = Doubles(self._folder / "host", devices) if devices else None
        self.box = self._make_box()
        self._programs: dict[str, Inside] = {}

    def __repr__(self) -> str:
        return f"<RealNode {self.name} {self.ip} {'up' if self.box.running else 'down'}>"

    @property
    def ip(self) -> str:
        """Its address on the control network, which Kubernetes knows it by."""
        return self._around.addresses.node_ip(self._index)

    @property
    def pod_ip(self) -> str:
        """Its address on the pods' network, behind the same link as its pods."""
        return self._around.addresses.pod_gateway(self._index)

    @property
    def netns(self) -> str:
        """A path for setns(2), while the node is up."""
        return self.box.netns

    @property
    def devices(self) -> Doubles:
        """Doubles of the devices it is declared with, to plug and unplug while it runs."""
        if self._doubles is None:
            raise TestbedError(f"{self.name} has the machine's devices: declare it with `devices` to have doubles")
        return self._doubles

    @property
    def containerd(self) -> Inside:
        return self._program("containerd")

    @property
    def kubelet(self) -> Inside:
        return self._program("kubelet")

    def limit_pods_cpu(self, cores: float) -> None:
        """Caps the CPU that all pods of the node use together; kubelet and containerd are not counted."""
        cgroups.limit_cpu(f"{self._cgroup}/{kubelet.PODS_CGROUP}", cores)

    def empty_dir(self, pod_uid: str, volume: str) -> Path:
        """Returns the folder of a pod's emptyDir on disk, so that it is read and written without a process in the pod."""
        return self._folder / "kubelet" / "pods" / pod_uid / "volumes" / "kubernetes.io~empty-dir" / volume

    def programs(self) -> dict[str, Inside]:
        return {program.name: program for program in self._programs.values()}

    # --- life -------------------------------------------------------------------------------------------------

    def boot(self) -> None:
        """Everything but the kubelet and kube-proxy, which need the API server."""
        cgroups.create(self._cgroup)
        self.box.start()
        self._plug_in()
        self._write_configuration()
        self._start_containerd()
        for reference, archive in self._around.images.items():
            self.import_image(reference, archive)

    def join(self) -> None:
        """Start the programs that make it a node of the cluster."""
        around = self._around
        program = kubelet.command(
            around.binaries["kubelet"],
            config=self._folder / "kubelet.yaml",
            kubeconfig=around.kubeconfig,
            name=self.name,
            address=self.ip,
            labels=self._description.labels,
        )
        self._start("kubelet", program)
        self._start("kube-proxy", [str(around.binaries["kube-proxy"]), f"--config={self._folder / 'kube-proxy.yaml'}"])

    def end(self) -> None:
        """Kill everything inside and wait until it is gone."""
        self.box.kill()
        for program in self._programs.values():
            program.wait(_SERVES_S)
        self._programs.clear()

    def close(self) -> None:
        """End it and what stands for its devices, for good."""
        self.end()
        if self._doubles:
            self._doubles.close()

    # --- faults -----------------------------------------------------------------------------------------------

    def crash(self) -> None:
        """Like pulling the plug: every process of the node ends at once, its links are gone, its disk stays."""
        self.end()
        left = sweep.remove_cgroups(self._cgroup, patience_s=_CGROUP_FREE_S)
        if left:
            raise TestbedError(f"the control groups {', '.join(map(str, left))} of {self.name} stay busy")
        shutil.rmtree(self._folder / "run", ignore_errors=True)

    def restart(self) -> None:
        """Power on after a crash, or a crash and power on."""
        if self.box.running:
            self.crash()
        self.box = self._make_box()
        self.boot()
        self._plug(self)
        self.join()

    def cut_off(self) -> None:
        """Unplug its control link: it cannot reach the API server, its pods go on and reach each other."""
        self._set_control_link("down")

    def reconnect(self) -> None:
        self._set_control_link("up")

    def ping(self, other: "RealNode", *, count: int = 10) -> Rtt:
        """What ping sees on the way the pods' frames take, through the latency switch."""
        busybox = prerequisites.required_program("busybox")
        options = ("-c", str(count), "-i", str(_PING_PAUSE_S), "-W", str(_PING_ANSWER_S))
        return figures(self.box.run(busybox, "ping", *options, other.pod_ip, check=False))

    def kill_container(self, container_id: str) -> None:
        """SIGKILL the first process of a container; `container_id` is that of the pod's status (`containerd://…`)."""
        self.ctr("tasks", "kill", "--signal=SIGKILL", container_id.rpartition("/")[2])

    def ctr(self, *args: str) -> str:
        """Output of containerd's own command, in the namespace that has the pods' containers."""
        return self.box.run(self._runtime_program("ctr"), f"--address={containerd.SOCKET}", "--namespace=k8s.io", *args)

    def import_image(self, reference: str, archive: Path) -> None:
        """Imports an image unless it is there: a node that comes back has kept its disk."""
        if reference not in self.ctr("images", "list", "--quiet").split():
            self.ctr("images", "import", str(archive))

    # --- inside -----------------------------------------------------------------------------------------------

    def _runtime_program(self, name: str) -> Path:
        return self._around.runtime / name if self._around.runtime else prerequisites.required_program(name)

    def _program(self, name: str) -> Inside:
        try:
            return self._programs[name]
        except KeyError:
            raise TestbedError(f"{name} of {self.name} is not running: the node is down") from None

    def _make_box(self) -> Box:
        folder = self._folder
        plan = Plan(
            hostname=self.name,
            overlays=("/var/lib", "/var/log"),
            binds=(
                (folder / "run", "/run"),
                (folder / "kubelet", kubelet.FOLDER),
                (folder / "cni", "/var/lib/cni"),
                (folder / "pod-logs", "/var/log/pods"),
                *(fake_host.mounts(self._doubles.host.root) if self._doubles else ()),
            ),
            sysctls=network.NODE_SYSCTLS,
            pretended=kubelet.PRETENDED,
        )
        return Box(
            self.name,
            plan,
            folder=folder,
            run_dir=self._around.run_dir,
            logs_dir=self._around.logs_dir,
        )

    def _plug_in(self) -> None:
        around = self._around
        around.hub.ip(*network.plug(self._index, node_pid=self.box.pid, data=around.plain_data))
        self.box.ip(*network.node(around.addresses, self._index, data=around.plain_data))
        self.box.run(prerequisites.required_program("iptables"), *network.way_out())

    def _set_control_link(self, state: str) -> None:
        if not self.box.running:
            raise TestbedError(f"{self.name} is down and has no link: restart it first")
        self._around.hub.ip(f"link set control{self._index} {state}")

    def _write_configuration(self) -> None:
        around, folder = self._around, self._folder
        network_folder = folder / "network"
        network_folder.mkdir(exist_ok=True)
        (network_folder / "10-pods.conflist").write_text(network.container_network(around.addresses, self._index))
        cni_bin = prerequisites.cni_folder()
        if cni_bin is None:
            raise prerequisites.UnavailableError(
                "the CNI plugins are not installed: see `python -m robotapp_testbed doctor`"
            )
        (folder / "containerd.toml").write_text(
            containerd.configuration(
                root=folder / "containerd",
                cni_bin=cni_bin,
                cni_conf=network_folder,
                privileged_oom=prerequisites.may_lower_oom_score(),
            )
        )
        self._write_yaml(
            "kubelet",
            kubelet.configuration(
                cgroup=self._cgroup,
                certificate=around.certificate,
                key=around.key,
                client_ca=around.client_ca,
                taints=self._description.taints,
            ),
        )
        self._write_yaml(
            "kube-proxy",
            services.proxy_configuration(
                kubeconfig=around.proxy_kubeconfig,
                node=self.name,
                bridged_traffic_is_filtered=prerequisites.bridged_traffic_is_filtered(),
            ),
        )

    def _write_yaml(self, name: str, document: Mapping[str, Any]) -> None:
        (self._folder / f"{name}.yaml").write_text(yaml.safe_dump(json.loads(json.dumps(document))))

    def _start_containerd(self) -> None:
        command = [str(self._runtime_program("containerd")), f"--config={self._folder / 'containerd.toml'}"]
        if self._around.runtime:  # it finds its shim on PATH
            command = ["/usr/bin/env", f"PATH={self._around.runtime}:{os.environ['PATH']}", *command]
        self._start("containerd", command)
        folder = self._folder / "run" / Path(containerd.SOCKET).parent.name
        if not wait_until(lambda: _serves(folder) or not self.containerd.running, timeout_s=_SERVES_S):
            raise TestbedError(
                f"containerd of {self.name} does not serve after {_SERVES_S:.0f} s: see {self.containerd}"
            )
        self.containerd.wait_ready()

    def _start(self, name: str, argv: Sequence[str]) -> None:
        self._programs[name] = self.box.program(name, argv)
        self._programs[name].start()


def _serves(folder: Path) -> bool:
    """Whether containerd takes connections: its socket is there a moment earlier."""
    try:
        descriptor = os.open(folder, os.O_PATH | os.O_DIRECTORY)
    except FileNotFoundError:
        return False
    try:
        with socket.socket(socket.AF_UNIX) as probe:
            # By way of the descriptor, since the path of a socket must be short.
            probe.connect(f"/proc/self/fd/{descriptor}/{Path(containerd.SOCKET).name}")
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return True
