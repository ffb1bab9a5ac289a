"""Programs of an image in namespaces of their own, without a kubelet: alone, or as a machine outside of a cluster."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from robotapp_testbed.images import oci
from robotapp_testbed.real import prerequisites
from robotapp_testbed.real.box import Box, Inside, Plan
from robotapp_testbed.real.config import network
from robotapp_testbed.real.config.addresses import Addresses


class ImageBox:
    """Has a network of its own with nothing but itself in it, and the root file system of an image in `root`."""

    def __init__(self, name: str, *, folder: Path, run_dir: Path, logs_dir: Path) -> None:
        self.name = name
        self.root = folder / "root"
        plan = Plan(hostname=name, binds=((Path("/dev"), f"{self.root}/dev"),), sysctls=network.OUTSIDER_SYSCTLS)
        self.box = Box(name, plan, folder=folder, run_dir=run_dir, logs_dir=logs_dir)

    def start(self, archive: Path) -> None:
        """Unpacks the image and starts the namespaces."""
        self.root.mkdir(parents=True)
        oci.unpack(archive, self.root)
        # The kubelet writes it for containers; images have none.
        (self.root / "etc" / "hosts").write_text(f"127.0.0.1 localhost {self.name}\n")
        self.box.start()
        self.box.ip("link set lo up", "link set lo multicast on")

    def run(self, line: str, env: Mapping[str, str]) -> str:
        """Returns the standard output of a line for sh; CommandError when it fails."""
        return self.box.run(*self._in_shell(line, env))

    def program(self, name: str, line: str, env: Mapping[str, str]) -> Inside:
        """Returns a line for sh as a program that is not started yet."""
        return self.box.program(name, self._in_shell(line, env))

    def _in_shell(self, line: str, env: Mapping[str, str]) -> list[str]:
        """Nothing of this process' environment is passed on."""
        variables = [f"{name}={value}" for name, value in env.items()]
        chroot = str(prerequisites.required_program("chroot"))
        return [chroot, str(self.root), "/usr/bin/env", "-i", *variables, "/bin/sh", "-c", line]


@dataclass(frozen=True, slots=True)
class Place:
    """Surroundings of a cluster for outsiders: its addresses, the hub of its networks, and the folders of its run."""

    addresses: Addresses
    hub: Box
    nodes: int
    run_dir: Path
    logs_dir: Path


class Outsider(ImageBox):
    """A machine on the network of a cluster's nodes, such as a laptop: no kubelet, no Service addresses, no cluster DNS.

    `index` numbers the outsiders of a cluster from 1.
    """

    def __init__(self, name: str, index: int, place: Place) -> None:
        folder = place.run_dir / "outsiders" / name
        super().__init__(name, folder=folder, run_dir=place.run_dir, logs_dir=place.logs_dir)
        self._place = place
        self._index = index

    def start(self, archive: Path) -> None:
        """Plugs the machine in, too, with a route to the pods of each node."""
        super().start(archive)
        self._place.hub.ip(*network.plug_outsider(self._index, outsider_pid=self.box.pid))
        self.box.ip(*network.outsider(self._place.addresses, self._index, nodes=self._place.nodes))
