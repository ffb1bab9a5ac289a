"""`python -m robotapp_agent.driver`: read flags, then serve the kubelet and publish devices until stopped."""

import argparse
import asyncio
import logging
import signal
import sys
from collections.abc import Coroutine, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from robotapp_agent.driver.kubelet import KubeletServer, SocketGoneError
from robotapp_agent.driver.node_files import CdiFolder, Checkpoint, CheckpointError, DeviceFiles, read_boot_id
from robotapp_agent.driver.plugin import DevicePlugin, NodeFolders
from robotapp_agent.driver.publisher import SlicePublisher
from robotapp_agent.process import logs
from robotapp_agent.process.health import Health
from robotapp_agent.process.run import node_source
from robotapp_agent.shell.device_scanner import SCAN_PERIOD_S, DeviceScanner, HostPaths
from robotapp_agent.shell.own_node import UnknownNodeError
from robotapp_api.values import arguments
from robotapp_claims.rules.device_attributes import DRIVER
from robotapp_client.api.client import ApiClient
from robotapp_client.transport.errors import LoginError
from robotapp_client.transport.kubeconfig import load

log = logging.getLogger(__name__)

MANAGER: Final = "robotapp-driver"
HEALTH_PORT: Final = 7313
KUBELET: Final = Path("/var/lib/kubelet")
CDI: Final = Path("/var/run/cdi")
REQUEST_S: Final = 10.0
"""The kubelet gives a preparation 45 s; reads are repeated within them."""


@dataclass(frozen=True, slots=True)
class Options:
    """Settings of the command line."""

    kubeconfig: Path | None
    node_name: str
    host_root: Path
    device_rules: Path | None
    kubelet_folder: Path
    cdi_folder: Path
    health_port: int
    log_format: str
    log_level: str


def main(argv: Sequence[str] | None = None) -> int:
    """0 after a clean stop, 1 when another start helps, 2 when flags, credentials, node or checkpoint cannot be used."""
    options = parse(argv)
    logs.set_up(options.log_format, options.log_level)
    code = 0
    try:
        asyncio.run(_run(options))
    except* (LoginError, UnknownNodeError, CheckpointError) as errors:
        print(f"robotapp-driver: {errors.exceptions[0]}", file=sys.stderr)  # noqa: T201 - for the person who started us
        code = 2
    except* (SocketGoneError, OSError) as errors:
        log.error("the driver ends and is to be started again: %s", errors.exceptions[0])  # noqa: TRY400 - no bug of ours
        code = 1
    return code


async def _run(options: Options) -> None:
    endpoint = load(options.kubeconfig)
    node = node_source(options.kubeconfig, options.node_name)
    name = node().name
    folders = NodeFolders(
        Checkpoint(options.kubelet_folder / "plugins" / DRIVER),
        CdiFolder(options.cdi_folder),
        DeviceFiles(options.host_root),
    )
    client = ApiClient(endpoint, user_agent=MANAGER, field_manager=MANAGER, max_connections=2, timeout_s=REQUEST_S)
    async with client:
        publisher = SlicePublisher(client, node)
        plugin = DevicePlugin(
            client, folders, node=name, boot_id=read_boot_id(), runtime_problem=lambda: publisher.runtime_problem
        )
        plugin.remove_leftovers()
        server = KubeletServer(plugin, options.kubelet_folder, registered=publisher.publish_soon)
        scanner = DeviceScanner(HostPaths.below(options.host_root), rules_path=options.device_rules, node=name)
        log.info("the driver of node %s starts, API server %s: %r", name, endpoint.server, plugin)
        await _scan(scanner, plugin, publisher)
        parts = [
            server.run(),
            publisher.run(),
            _keep_scanning(scanner, plugin, publisher),
            plugin.forget_gone_claims(),
        ]
        if options.health_port:
            # It answers as long as the loop runs; nothing else here is cured by another start.
            parts.append(Health(list).serve(options.health_port))
        await _run_together(parts)


async def _run_together(parts: Sequence[Coroutine[Any, Any, None]]) -> None:
    """Runs all parts until SIGTERM or SIGINT, or until one fails."""
    stopping = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stopping.set)
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(part) for part in parts]
        await stopping.wait()
        for task in tasks:
            task.cancel()


async def _keep_scanning(scanner: DeviceScanner, plugin: DevicePlugin, publisher: SlicePublisher) -> None:
    pause_s = SCAN_PERIOD_S
    while True:
        await asyncio.sleep(pause_s)
        pause_s = await _scan(scanner, plugin, publisher)


async def _scan(scanner: DeviceScanner, plugin: DevicePlugin, publisher: SlicePublisher) -> float:
    """Scans in a thread, because a broken device can make sysfs slow. Returns the seconds until the next scan."""
    scan = await asyncio.to_thread(scanner.scan)
    if scan.problem:
        log.debug("devices: %s", scan.problem)  # the agent beside us warns of it
    plugin.update_devices(scan.devices)
    publisher.update_devices(scan.devices)
    return scan.next_s


def parse(argv: Sequence[str] | None = None) -> Options:
    """Exits with a usage text on a mistake, as argparse does."""
    parser = argparse.ArgumentParser(
        prog="robotapp-driver",
        description=f"The DRA driver {DRIVER}: publishes this node's devices as ResourceSlices and hands them to containers.",
    )
    parser.add_argument("--kubeconfig", type=Path, help="default: the service account of the pod it runs in")
    parser.add_argument(
        "--node-name", type=arguments.name, default="", help="default: the node of the token, else $NODE_NAME"
    )
    parser.add_argument(
        "--host-root", type=Path, default=Path("/"), help="folder with the node's sys, dev and run/udev"
    )
    parser.add_argument("--device-rules", type=Path, help="file of rules that name, add or ignore devices")
    parser.add_argument("--kubelet-folder", type=Path, default=KUBELET, help=f"default: {KUBELET}")
    parser.add_argument("--cdi-folder", type=Path, default=CDI, help=f"CDI specs for the runtime; default: {CDI}")
    health = f"TCP port of /healthz, 0 for none; default: {HEALTH_PORT}"
    parser.add_argument("--health-port", type=arguments.port, default=HEALTH_PORT, help=health)
    parser.add_argument("--log-format", choices=("text", "json"), default="text")
    parser.add_argument("--log-level", choices=("debug", "info", "warning", "error"), default="info")
    return Options(**vars(parser.parse_args(argv)))
