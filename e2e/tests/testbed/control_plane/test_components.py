from pathlib import Path

import pytest
import yaml

from robotapp_testbed.control_plane import components
from robotapp_testbed.control_plane.components import Layout, Settings

LAYOUT = Layout(Path("/run/cp"), 1, 2, 3, 4)


@pytest.mark.parametrize("settings", [Settings(), Settings(audit=True, controller_manager=False)])
def test_every_server_listens_on_loopback_only(settings: Settings) -> None:
    lines = [*components.etcd(LAYOUT), *components.kube_apiserver(LAYOUT, settings), *components.kwok(LAYOUT, settings)]
    addresses = [line for line in lines if "://" in line or "address" in line]
    assert addresses
    assert all("127.0.0.1" in line for line in addresses if "kubernetes.default.svc" not in line)


def test_every_file_is_in_the_run_folder() -> None:
    settings = Settings(audit=True)
    lines = [
        *components.etcd(LAYOUT),
        *components.kube_apiserver(LAYOUT, settings),
        *components.kube_controller_manager(LAYOUT, settings),
    ]
    paths = [value for _, _, value in (line.partition("=") for line in lines) if value.startswith("/")]
    assert len(paths) >= 8
    assert all(path.startswith("/run/cp/") for path in paths)


def test_the_oracle_scores_every_node_without_a_rate_limit() -> None:
    config = yaml.safe_load(components.oracle_config(Path("/k")))
    assert config["percentageOfNodesToScore"] == 100
    assert config["leaderElection"] == {"leaderElect": False}
    assert config["clientConnection"]["qps"] >= 1000
