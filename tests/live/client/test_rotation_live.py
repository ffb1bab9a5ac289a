"""The authority of a real API server is rotated under programs that run: they go on. Its own control plane."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from campaigns.rigs.simulated_site import plain_app
from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_client import ApiClient, Unreachable, load
from robotapp_client.api.resources import CONFIGMAPS
from robotapp_client.transport.kubeconfig import Endpoint
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines.nodes import edge

pytestmark = pytest.mark.live

WITHIN_S = 90.0


@pytest.fixture
def plane() -> Iterator[ControlPlane]:
    with ControlPlane(kwok=False, controller_manager=False) as started:
        product.install(started)
        yield started


@pytest.fixture
def files(plane: ControlPlane, tmp_path: Path) -> Path:
    """A folder with ca.crt and a kubeconfig that names it, as a user has them."""
    shutil.copy(plane.ca_file, tmp_path / "ca.crt")
    config = yaml.safe_load(plane.kubeconfig("admin").read_text())
    cluster = config["clusters"][0]["cluster"]
    del cluster["certificate-authority-data"]
    cluster["certificate-authority"] = "ca.crt"
    (tmp_path / "kubeconfig").write_text(yaml.safe_dump(config))
    return tmp_path


def open_client(endpoint: Endpoint) -> ApiClient:
    return ApiClient(endpoint, user_agent="test", timeout_s=20)


async def test_a_client_follows_its_file_and_one_without_the_new_authority_is_not_fooled(
    plane: ControlPlane, files: Path
) -> None:
    async with open_client(load(files / "kubeconfig")) as client:
        await client.list(CONFIGMAPS, namespace="default")
        plane.rotate_authority()
        with pytest.raises(Unreachable, match="CERTIFICATE_VERIFY_FAILED"):
            await client.list(CONFIGMAPS, namespace="default")
        shutil.copy(plane.ca_file, files / "ca.crt")
        await client.list(CONFIGMAPS, namespace="default")


def has(plane: ControlPlane, path: str) -> Callable[[], bool]:
    return lambda: bool(plane.api.get(path)["items"])


def test_operator_and_scheduler_work_on_after_a_rotation(plane: ControlPlane) -> None:
    """Their kubeconfigs are replaced, as a Secret that holds one is."""
    stage = Stage(plane, "default")
    with nodes(plane, edge("edge-1")):
        scheduler = product.start_scheduler(plane, name="rotated", log_format="text")
        operator = product.start_operator(plane, log_format="text")
        pids = scheduler.pid, operator.pid
        stage.create_pod(pod("before"))
        stage.wait_bound("before")
        plane.rotate_authority()
        stage.create_pod(pod("after"))
        stage.wait_bound("after", timeout_s=WITHIN_S)
        app = plain_app("after")
        plane.api.create(f"/apis/{app['apiVersion']}/namespaces/default/robotapps", app)
        deployments = "/apis/apps/v1/namespaces/default/deployments"
        assert wait_until(has(plane, deployments), timeout_s=WITHIN_S), operator.log_text()[-3000:]
        assert scheduler.running
        assert operator.running
        assert (scheduler.pid, operator.pid) == pids
