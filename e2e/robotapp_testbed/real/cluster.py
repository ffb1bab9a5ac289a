"""A control plane whose nodes are real: kubelets with containers, joined by links of their own.

with RealNodes(["robot-1", "edge-1", robot("amr-07")]) as cp:
    cp.kubectl("get", "nodes")
    cp.node("edge-1").crash()
"""

import re
import signal
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from subprocess import Popen
from typing import Any, Final

from robotapp_api.model.names import Label
from robotapp_testbed import images
from robotapp_testbed.binaries import container_runtime, pins, programs
from robotapp_testbed.binaries.assets import Assets
from robotapp_testbed.control_plane import components
from robotapp_testbed.control_plane.authority import Authority
from robotapp_testbed.control_plane.controlplane import ControlPlane, start_guard
from robotapp_testbed.control_plane.identity import Identity
from robotapp_testbed.control_plane.servers import Program, answers
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.machines.nodes import SimulatedNode
from robotapp_testbed.processes import ports
from robotapp_testbed.processes.process import Process, wait_until
from robotapp_testbed.real import iproute, prerequisites, slots
from robotapp_testbed.real.box import Box, Plan
from robotapp_testbed.real.config import network, services
from robotapp_testbed.real.config.addresses import NODES, POD_BRIDGE, Addresses
from robotapp_testbed.real.image_box import Outsider, Place
from robotapp_testbed.real.node import Description, RealNode, Surroundings
from robotapp_testbed.real.scripts import sweep
from robotapp_testbed.switch import LatencySwitch
from robotapp_testbed.switch.links import problem_of

NAME: Final = re.compile(r"[a-z0-9]([a-z0-9-]{0,38}[a-z0-9])?")
"""Of a node: part of a host name, of folders and of control groups."""
_READY_S = 120.0
_PARALLEL = 4
_ROOM_PER_NODE_MB = 40
_TAP = "lat0"
_KUBELET_CLIENT = Identity(user="kube-apiserver-kubelet-client", groups=("system:masters",))
_OF_THE_MACHINE = {Label.SIMULATED, Label.HOSTNAME, "kubernetes.io/os", "kubernetes.io/arch"}


class RealNodes(ControlPlane):
    """etcd, kube-apiserver, kube-controller-manager, kube-scheduler, CoreDNS, and one real node per entry of `nodes`.

    An entry is a name, or a node of robotapp_testbed.machines.nodes, whose name, labels, taints and devices are taken:
    the agent on a node with devices finds doubles of those, else what this machine has. `delays` are one-way
    milliseconds by pair of names: with them (an empty mapping will do) the latency switch carries what pods send to other
    nodes, without them a plain bridge does. `images` are names of robotapp_testbed.images, there on every node. With `cdi`
    the nodes run a containerd that gives containers the devices of their claims. Needs root and a few packages:
    UnavailableError says which. The other arguments are those of ControlPlane.
    """

    def __init__(
        self,
        nodes: Iterable[str | SimulatedNode],
        delays: Mapping[tuple[str, str], float] | None = None,
        *,
        images: Sequence[str] = ("tools",),
        cdi: bool = False,
        kube_scheduler: bool | str | Path = True,
        kwok: bool = False,
        audit: bool | str = False,
        identities: Mapping[str, Identity] | None = None,
        extra_args: Mapping[str, Sequence[str]] | None = None,
        assets: Assets | None = None,
    ) -> None:
        self._descriptions = [_description(each) for each in nodes]
        names = [each.name for each in self._descriptions]
        check(names, (delays or {}).items())
        own = {_identity_of(name): Identity(f"system:node:{name}", ("system:nodes",)) for name in names}
        own |= {"kube-proxy": Identity(services.PROXY_USER), "coredns": Identity(services.DNS_USER)}
        super().__init__(
            kwok=kwok,
            kube_scheduler=kube_scheduler,
            audit=audit,
            identities={**own, **(identities or {})},
            extra_args=extra_args,
            assets=assets,
        )
        self._tools += pins.REAL_ONLY
        self._given_args = extra_args or {}
        self._delays = delays
        self._images = ("pause", *images)
        self._cdi = cdi
        self._switch: LatencySwitch | None = None
        self._slot: slots.Slot | None = None
        self._nodes: dict[str, RealNode] = {}
        self._boxes: list[Box] = []
        self._outsiders: Place | None = None

    @property
    def addresses(self) -> Addresses:
        if self._slot is None:
            raise TestbedError("the cluster is not started")
        return self._slot.addresses

    @property
    def nodes(self) -> dict[str, RealNode]:
        return dict(self._nodes)

    def node(self, name: str) -> RealNode:
        try:
            return self._nodes[name]
        except KeyError:
            has = ", ".join(self._nodes) or "none, it is not started"
            raise TestbedError(f"there is no node {name}; the cluster has {has}") from None

    @property
    def switch(self) -> LatencySwitch:
        """What joins the nodes, to set delay, jitter, loss and bandwidth of every pair."""
        if self._delays is None:
            raise TestbedError("these nodes are joined by a plain bridge: pass delays={} for the latency switch")
        if self._switch is None:
            raise TestbedError("the cluster is not started")
        return self._switch

    def add_outsider(self, name: str, *, image: str) -> Outsider:
        """Starts a machine that is no node on the nodes' network, with the programs of an image; it ends with the cluster."""
        if self._outsiders is None:
            raise TestbedError("the cluster is not started")
        outsider = Outsider(name, len(self._boxes), self._outsiders)  # the hub is the first box
        self._boxes.append(outsider.box)
        outsider.start(images.archive(image))
        return outsider

    def import_image(self, name: str, nodes: Iterable[str]) -> None:
        """Imports an image of robotapp_testbed.images on nodes that do not have it yet, on some of them at once."""
        reference, archive = images.reference(name), images.archive(name)
        with ThreadPoolExecutor(_PARALLEL) as pool:
            for task in [pool.submit(self.node(node).import_image, reference, archive) for node in nodes]:
                task.result()

    def plug_switch(self) -> None:
        """Attach all nodes that are up, with the delays the cluster was made with; for a switch that has just started."""
        for node in self._nodes.values():
            if node.box.running:
                self._attach(node)
        for (one, other), delay_ms in (self._delays or {}).items():
            self.switch.set_link(one, other, delay_ms=delay_ms)

    def process(self, name: str) -> Process:
        """Also `kubelet@NODE`, `containerd@NODE` and `kube-proxy@NODE`."""
        return self._node_programs().get(name) or super().process(name)

    def pids(self) -> dict[str, int]:
        """Those of the nodes' programs are of the programs themselves, as the host counts."""
        inside = {name: pid for name, each in self._node_programs().items() for pid in each.program_pids()}
        return {**super().pids(), **inside}

    def ready_nodes(self) -> set[str]:
        return {name for name, problems in self._problems().items() if not problems}

    def wait_nodes(self, *, timeout_s: float = _READY_S) -> None:
        """Until all nodes are Ready and take pods."""
        if not wait_until(lambda: self.ready_nodes() >= self._nodes.keys(), timeout_s=timeout_s, poll_s=0.1):
            found = self._problems()
            late = {name: found.get(name, ["it never registered"]) for name in sorted(self._nodes)}
            told = "; ".join(f"{name} ({', '.join(problems)})" for name, problems in late.items() if problems)
            raise TestbedError(f"not Ready after {timeout_s:.0f} s: {told}. See kubelet@*.log in {self.logs_dir}")

    # --- life -------------------------------------------------------------------------------------------------

    def start(self) -> "RealNodes":
        prerequisites.require()
        self._slot = slots.take()
        try:
            return super().start()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """End all nodes at once, then the control plane; what the kernel leaves is removed."""
        run_dir, slot = self._run_dir, self._slot
        for box in [*(node.box for node in self._nodes.values()), *self._boxes]:
            box.process.send(signal.SIGKILL)
        for node in self._nodes.values():
            node.close()
        for box in self._boxes:
            box.kill()
        self._nodes.clear()
        self._boxes.clear()
        self._outsiders = None
        self._switch = None
        if slot:
            sweep.remove_cgroups(slot.addresses.cgroup)
        super().close()
        if slot:
            ours = slot.addresses
            sweep.sweep(run_dir=run_dir, cgroup=ours.cgroup, host_link=ours.host_link)
            slot.release()
            self._slot = None

    # --- inside -----------------------------------------------------------------------------------------------

    def _problems(self) -> dict[str, list[str]]:
        """By node that has registered, what keeps it from taking pods."""
        return {item["metadata"]["name"]: _problems(item) for item in self.api.get("/api/v1/nodes")["items"]}

    def _node_programs(self) -> dict[str, Any]:
        return {name: program for node in self._nodes.values() for name, program in node.programs().items()}

    def _room_mb(self) -> int:
        return super()._room_mb() + _ROOM_PER_NODE_MB * len(self._descriptions)

    def _start_guard(self, run_dir: Path) -> Popen[bytes]:
        if self._slot is None:
            raise TestbedError("the cluster is not started")
        self._slot.note(run_dir)
        ours = self.addresses
        return start_guard(
            run_dir,
            afterwards=[sweep.__file__, str(run_dir), ours.cgroup, ours.host_link],
            keeps=(self._slot.descriptor,),
        )

    def _make_layout(self, run_dir: Path) -> components.Layout:
        return replace(components.Layout.create(run_dir), host=self.addresses.host_ip)

    def _write_files(self, layout: components.Layout, binaries: Mapping[str, Path]) -> None:
        super()._write_files(layout, binaries)
        authority = Authority("robotapp-nodes")
        (layout.run_dir / "nodes-ca.crt").write_text(authority.pem)
        authority.user(layout.run_dir / "kubelet-client", _KUBELET_CLIENT.user, *_KUBELET_CLIENT.groups)
        for index, description in self._numbered():
            authority.server(layout.run_dir / "serving" / description.name, self.addresses.node_ip(index))
        self._extra_args = _merged(_server_arguments(layout.run_dir), self._given_args)

    def _start_servers(self, layout: components.Layout, binaries: Mapping[str, Path]) -> None:
        hub = self._start_hub(layout)
        self._outsiders = Place(
            self.addresses, hub, nodes=len(self._descriptions), run_dir=layout.run_dir, logs_dir=layout.logs_dir
        )
        archives = {images.reference(name): images.archive(name) for name in self._images}
        if self._delays is not None:
            self._switch = LatencySwitch(run_dir=layout.run_dir)
            self.add_process(self._switch.process)
            self._switch.start()
        for index, description in self._numbered():
            around = self._surroundings(layout, binaries, hub, description.name, archives)
            self._nodes[description.name] = RealNode(description, index, around, plug=self._attach)
        with ThreadPoolExecutor(_PARALLEL) as pool:
            booting = [pool.submit(node.boot) for node in self._nodes.values()]
            super()._start_servers(layout, binaries)
            self._start_dns(layout)
            for booted in booting:
                booted.result()
        if self._switch:
            self.plug_switch()
        for node in self._nodes.values():
            node.join()
        self.wait_nodes()

    def _attach(self, node: RealNode) -> None:
        """A node that came up: its way to the other nodes' pods, unless that is the plain bridge."""
        if self._switch:
            self._switch.attach(node.name, pid=node.box.pid, tap=_TAP, bridge=POD_BRIDGE)

    def _numbered(self) -> list[tuple[int, Description]]:
        return list(enumerate(self._descriptions, start=1))

    def _start_hub(self, layout: components.Layout) -> Box:
        plan = Plan(hostname="hub", sysctls=network.HUB_SYSCTLS)
        folder = layout.run_dir / "hub"
        folder.mkdir()
        hub = Box("hub", plan, folder=folder, run_dir=layout.run_dir, logs_dir=layout.logs_dir)
        self._boxes.append(hub)
        hub.start()
        hub.ip(*network.hub())
        iproute.batch(network.host(self.addresses, hub_pid=hub.pid))
        hub.ip(*network.hub_of_host())
        return hub

    def _surroundings(
        self, layout: components.Layout, binaries: Mapping[str, Path], hub: Box, name: str, archives: Mapping[str, Path]
    ) -> Surroundings:
        serving = layout.run_dir / "serving" / name
        return Surroundings(
            addresses=self.addresses,
            hub=hub,
            run_dir=layout.run_dir,
            logs_dir=layout.logs_dir,
            binaries=binaries,
            kubeconfig=layout.kubeconfig(_identity_of(name)),
            proxy_kubeconfig=layout.kubeconfig("kube-proxy"),
            certificate=serving / "tls.crt",
            key=serving / "tls.key",
            client_ca=layout.run_dir / "nodes-ca.crt",
            images=archives,
            runtime=container_runtime.build() if self._cdi else None,
            plain_data=self._delays is None,
        )

    def _start_dns(self, layout: components.Layout) -> None:
        self.kubectl("apply", "--server-side", "-f", "-", stdin=services.dns_objects(self.addresses.host_ip))
        (port,) = ports.free_ports(1)
        corefile = layout.run_dir / "Corefile"
        text = services.corefile(
            address=self.addresses.host_ip, kubeconfig=layout.kubeconfig("coredns"), ready_port=port
        )
        corefile.write_text(text)
        process = Process(
            "coredns",
            [programs.build("cluster-dns"), "-conf", corefile],
            run_dir=layout.run_dir,
            log_path=layout.logs_dir / "coredns.log",
            ready=lambda: answers(f"http://127.0.0.1:{port}/ready"),
        )
        self.add_process(process).start()


def check(names: Sequence[str], delays: Iterable[tuple[tuple[str, str], float]]) -> None:
    """TestbedError when no cluster can have nodes of these names, or these delays between pairs of them. Pure."""
    if not 1 <= len(names) <= NODES:
        raise TestbedError(f"a cluster has 1 to {NODES} real nodes, not {len(names)}")
    wrong = [name for name in names if not NAME.fullmatch(name)]
    if wrong:
        raise TestbedError(f"{wrong[0]!r} is no node name: use up to 40 small letters, digits and dashes")
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise TestbedError(f"nodes need different names: {', '.join(twice)} is there twice")
    _check_delays(names, delays)


def _check_delays(names: Sequence[str], delays: Iterable[tuple[tuple[str, str], float]]) -> None:
    seen: set[frozenset[str]] = set()
    for (one, other), delay_ms in delays:
        pair = frozenset((one, other))
        if one == other:
            raise TestbedError(f"a delay is between two nodes, not from {one} to itself")
        unknown = [name for name in (one, other) if name not in names]
        if unknown:
            raise TestbedError(f"a delay names {', '.join(unknown)}, but the nodes are {', '.join(names)}")
        if problem := problem_of("delay_ms", delay_ms):
            raise TestbedError(f"the delay between {one} and {other}: {problem}")
        if pair in seen:
            raise TestbedError(f"the delay between {one} and {other} is there twice: it is that of both ways")
        seen.add(pair)


def _identity_of(node: str) -> str:
    return f"node-{node}"


def _description(node: str | SimulatedNode) -> Description:
    if isinstance(node, str):
        return Description(node)
    own = replace(node, devices=()).all_labels()  # devices, and labels of them, are the agent's to find
    labels = {key: value for key, value in own.items() if key not in _OF_THE_MACHINE}
    return Description(node.name, labels, node.taints, node.devices)


def _server_arguments(run_dir: Path) -> dict[str, list[str]]:
    client = run_dir / "kubelet-client"
    return {
        Program.API: [
            f"--client-ca-file={run_dir / 'nodes-ca.crt'}",
            f"--kubelet-certificate-authority={run_dir / 'nodes-ca.crt'}",
            f"--kubelet-client-certificate={client / 'tls.crt'}",
            f"--kubelet-client-key={client / 'tls.key'}",
            "--kubelet-preferred-address-types=InternalIP",
            "--enable-admission-plugins=NodeRestriction",
        ],
        Program.CONTROLLER_MANAGER: ["--node-monitor-period=1s", "--node-monitor-grace-period=8s"],
    }


def _merged(own: Mapping[str, Sequence[str]], given: Mapping[str, Sequence[str]]) -> dict[str, Sequence[str]]:
    """The caller's arguments come last, so they win."""
    return {name: [*own.get(name, ()), *given.get(name, ())] for name in {*own, *given}}


def _problems(node: Mapping[str, Any]) -> list[str]:
    """Why a node takes no pods; empty when it does."""
    conditions = {each["type"]: each for each in node.get("status", {}).get("conditions", [])}
    ready = conditions.get("Ready", {"status": "Unknown"})
    taints = [each["key"] for each in node["spec"].get("taints", []) if each["key"].startswith("node.kubernetes.io/")]
    return taints + ([] if ready["status"] == "True" else [ready.get("message") or "it has not said that it is Ready"])
