"""The authority of a real API server is rotated under programs that run: they go on. Its own control plane."""

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml
from tests.live.agent.agent_process import agent, status_of

from campaigns.rigs.simulated_site import plain_app
from campaigns.rigs.stage import Stage, nodes, pod
from robotapp_client import ApiClient, Unreachable, load
from robotapp_client.api.resources import CONFIGMAPS
from robotapp_client.transport.kubeconfig import Endpoint
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane import product
from robotapp_testbed.control_plane.api import Api
from robotapp_testbed.failures import ApiStatusError
from robotapp_testbed.machines.fake_host import FakeHost
from robotapp_testbed.machines.nodes import edge

pytestmark = pytest.mark.live

WITHIN_S = 90.0
USER = "rotated"
NODE = "robot-rotated"
PROGRAM = Path(sys.executable).parent / "kubectl-robotapp"


@pytest.fixture
def plane() -> Iterator[ControlPlane]:
    with ControlPlane(kwok=False, controller_manager=False) as started:
        product.install(started)
        yield started


@pytest.fixture
def files(plane: ControlPlane, tmp_path: Path) -> Path:
    """A folder with ca.crt, token and a kubeconfig that names them, as a user has them. The token is revoked with its Secret."""
    shutil.copy(plane.ca_file, tmp_path / "ca.crt")
    plane.kubectl("create", "serviceaccount", USER, "-n", "default")
    plane.kubectl(
        "create", "clusterrolebinding", USER, "--clusterrole=cluster-admin", f"--serviceaccount=default:{USER}"
    )
    (tmp_path / "token").write_text(make_token(plane, "first"))
    config = yaml.safe_load(plane.kubeconfig("admin").read_text())
    cluster = config["clusters"][0]["cluster"]
    del cluster["certificate-authority-data"]
    cluster["certificate-authority"] = "ca.crt"
    config["users"][0]["user"] = {"tokenFile": "token"}
    (tmp_path / "kubeconfig").write_text(yaml.safe_dump(config))
    return tmp_path


def make_token(plane: ControlPlane, secret: str) -> str:
    """A token that is good while this Secret is there."""
    plane.kubectl("create", "secret", "generic", secret, "-n", "default")
    bound = ("--bound-object-kind=Secret", f"--bound-object-name={secret}")
    return plane.kubectl("create", "token", USER, "-n", "default", *bound).strip()


def rotate_token(plane: ControlPlane, files: Path) -> None:
    """The file gets another token, and the one before is refused from now on."""
    before = (files / "token").read_text()
    (files / "token").write_text(make_token(plane, "second"))
    plane.kubectl("delete", "secret", "first", "-n", "default")
    old = Api(plane.server_url, ca_file=plane.ca_file, token=before)
    try:
        assert wait_until(lambda: is_refused(old), timeout_s=WITHIN_S), "the API server remembers a token for seconds"
    finally:
        old.close()


def is_refused(api: Api) -> bool:
    try:
        api.get("/api/v1/namespaces/default")
    except ApiStatusError as error:
        return error.status == 401
    return False


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


def test_an_agent_reports_on_after_its_authority_and_its_token_were_rotated(
    plane: ControlPlane, files: Path, tmp_path: Path
) -> None:
    host = FakeHost(tmp_path / "host")
    process = agent(plane, NODE, f"--kubeconfig={files / 'kubeconfig'}", host_root=host.root)
    process.start().wait_ready()
    try:
        await_report(plane, 0)
        pid = process.pid
        plane.rotate_authority()
        silent = read_sequence(plane)
        assert wait_until(lambda: "CERTIFICATE_VERIFY_FAILED" in process.log_text(), timeout_s=WITHIN_S)
        assert read_sequence(plane) == silent, "nothing is written to a server whose authority is not known"
        shutil.copy(plane.ca_file, files / "ca.crt")
        await_report(plane, silent)
        rotate_token(plane, files)
        await_report(plane, read_sequence(plane))
        assert process.running
        assert process.pid == pid
    finally:
        process.stop()


def read_sequence(plane: ControlPlane) -> int:
    return int(status_of(plane, NODE).get("seq", 0))


def await_report(plane: ControlPlane, before: int) -> None:
    assert wait_until(lambda: read_sequence(plane) > before, timeout_s=WITHIN_S)


def test_the_command_line_takes_the_files_as_they_are_and_says_which_authority_is_wrong(
    plane: ControlPlane, files: Path
) -> None:
    def run() -> subprocess.CompletedProcess[str]:
        environment = {"KUBECONFIG": str(files / "kubeconfig"), "PATH": "/usr/bin:/bin"}
        command = [PROGRAM, "list", "-n", "default"]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)

    assert run().returncode == 0
    plane.rotate_authority()
    refused = run()
    assert refused.returncode != 0
    assert "CERTIFICATE_VERIFY_FAILED" in refused.stderr
    assert "Traceback" not in refused.stderr
    shutil.copy(plane.ca_file, files / "ca.crt")
    rotate_token(plane, files)
    done = run()
    assert done.returncode == 0, done.stderr
