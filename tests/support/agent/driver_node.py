"""A node on which a driver runs: folders that outlive it, an API server and a kubelet."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from tests.support.agent.dra import BOOT, NODE, FakeKubelet, claim, device
from tests.support.apiserver import FakeApiServer

from robotapp_agent.devices.device import Device
from robotapp_agent.driver.kubelet import KubeletServer
from robotapp_agent.driver.node_files import CdiFolder, Checkpoint, DeviceFiles
from robotapp_agent.driver.plugin import DevicePlugin, NodeFolders, Patience
from robotapp_client import ApiClient
from robotapp_client.api.resources import RESOURCECLAIMS

ZERO = device(path="/dev/zero")
"""A character device that every machine has stands for the adapter."""


class Node:
    """One node: its folders live on when the driver is killed."""

    def __init__(self, folder: Path, api: FakeApiServer, client: ApiClient) -> None:
        self.folder = folder
        self.api = api
        self.client = client
        self.cdi = CdiFolder(folder / "cdi")
        self.checkpoint = Checkpoint(folder / "state")
        self.kubelet = FakeKubelet(folder)
        self.registrations = 0
        self.patience = Patience(0, 0)

    def start_plugin(self, *, boot_id: str = BOOT, devices: tuple[Device, ...] = (ZERO,)) -> DevicePlugin:
        """A driver that has just started."""
        folders = NodeFolders(self.checkpoint, self.cdi, DeviceFiles(Path("/")))
        plugin = DevicePlugin(self.client, folders, node=NODE, boot_id=boot_id, patience=self.patience)
        plugin.remove_leftovers()
        plugin.update_devices(devices)
        return plugin

    @contextlib.asynccontextmanager
    async def run(self, *, boot_id: str = BOOT, devices: tuple[Device, ...] = (ZERO,)) -> AsyncIterator[DevicePlugin]:
        """Serves the sockets until the end of the block, which is a kill as far as the files go."""
        plugin = self.start_plugin(boot_id=boot_id, devices=devices)

        def count() -> None:
            self.registrations += 1

        task = asyncio.create_task(KubeletServer(plugin, self.folder, registered=count).run())
        try:
            await self.kubelet.wait_for_driver()
            yield plugin
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    def allocate(self, name: str, *results: dict[str, Any], **more: Any) -> None:
        body = claim(name, *results, **more)
        self.api.store.put(RESOURCECLAIMS, body, uid=body["metadata"]["uid"])

    def deallocate(self, name: str) -> None:
        body = claim(name)
        self.api.store.put(RESOURCECLAIMS, {**body, "status": {}}, uid=body["metadata"]["uid"])

    def spec(self, name: str) -> dict[str, Any]:
        spec: dict[str, Any] = json.loads((self.cdi.folder / f"devices.robotics.io-uid-of-{name}.json").read_text())
        return spec


class SlowRead:
    """The API server's answer about one object stays on its way until `may_return`."""

    def __init__(self, get: Any, name: str) -> None:
        self._get = get
        self._name = name
        self.was_read = asyncio.Event()
        self.may_return = asyncio.Event()

    async def __call__(self, resource: Any, name: str, **options: Any) -> Any:
        answer = await self._get(resource, name, **options)
        if name == self._name:
            self.was_read.set()
            await self.may_return.wait()
        return answer
