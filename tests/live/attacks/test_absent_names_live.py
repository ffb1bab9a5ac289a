"""A tenant names thousands of ConfigMaps that do not exist: nobody else's operator may end of it."""

import asyncio
import json
import subprocess
import sys

import pytest
from tests.support.clients import until

from robotapp_client import ApiClient, Reflector
from robotapp_client.api.resources import CONFIGMAPS
from robotapp_client.transport.kubeconfig import load
from robotapp_client.transport.metadata import MetadataTransport
from robotapp_testbed import ControlPlane
from robotapp_testbed.binaries.pins import REPOSITORY

pytestmark = pytest.mark.live

APPS, NAMES = 200, 64


@pytest.mark.parametrize("namespaces", [1, 50])
def test_64_absent_names_of_200_apps_cost_less_than_50_mb(
    installed_plane: ControlPlane, namespace: str, namespaces: int
) -> None:
    """One watch per name was 12,800 watches; listing and watching a namespace that does not exist is allowed."""
    where = [namespace, *(f"{namespace}-{number}" for number in range(1, namespaces))]
    body = {"metadata": {"name": "present"}, "data": {"params.yaml": "a: 1"}}
    installed_plane.api.create(f"/api/v1/namespaces/{namespace}/configmaps", body)
    kubeconfig = str(installed_plane.kubeconfig("operator"))
    command = [sys.executable, "-m", "campaigns.operating.params_load", kubeconfig, str(APPS), str(NAMES), *where]
    ran = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=True, timeout=300)
    cost = json.loads(ran.stdout)
    assert cost["read"] == 1
    assert cost["grown_mb"] < 50


async def test_what_is_in_config_maps_that_no_app_names_never_comes_over_the_wire(
    installed_plane: ControlPlane, namespace: str
) -> None:
    path = f"/api/v1/namespaces/{namespace}/configmaps"
    endpoint = load(installed_plane.kubeconfig("operator"))
    transport = MetadataTransport(endpoint, user_agent="test")
    body = {"data": {"huge": "x" * 1000}}
    installed_plane.api.create(path, {"metadata": {"name": "listed"}, **body})
    async with ApiClient(endpoint, user_agent="test", transport=transport) as client:
        reflector = Reflector(client, CONFIGMAPS, as_type=dict, namespace=namespace)
        async with asyncio.TaskGroup() as group:
            task = group.create_task(reflector.run())
            await reflector.synced.wait()
            await asyncio.to_thread(installed_plane.api.create, path, {"metadata": {"name": "watched"}, **body})
            await until(lambda: f"{namespace}/watched" in reflector.store)
            task.cancel()
    assert {f"{namespace}/listed", f"{namespace}/watched"} <= set(reflector.store)
    assert not any("data" in each for each in reflector.store.values())
