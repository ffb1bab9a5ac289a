from pathlib import Path

import pytest
import yaml

from robotapp_api.model.names import Label
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


def test_without_controllers_pods_need_no_service_account() -> None:
    flag = "--disable-admission-plugins=ServiceAccount"
    assert flag in components.kube_apiserver(LAYOUT, Settings(controller_manager=False))
    assert flag not in components.kube_apiserver(LAYOUT, Settings())


def test_the_audit_log_is_kept_only_when_asked_for() -> None:
    assert any("audit" in line for line in components.kube_apiserver(LAYOUT, Settings(audit=True)))
    assert not any("audit" in line for line in components.kube_apiserver(LAYOUT, Settings()))


@pytest.mark.parametrize("lease_s", [40, 400])
def test_a_node_is_given_up_only_after_its_lease(lease_s: int) -> None:
    settings = Settings(node_lease_s=lease_s)
    assert f"--node-lease-duration-seconds={lease_s}" in components.kwok(LAYOUT, settings)
    assert f"--node-monitor-grace-period={lease_s + 10}s" in components.kube_controller_manager(LAYOUT, settings)


def test_kwok_runs_the_five_stages_on_simulated_nodes_only() -> None:
    lines = components.kwok(LAYOUT, Settings())
    assert f"--manage-nodes-with-label-selector={Label.SIMULATED}=kwok" in lines
    assert len([line for line in lines if line.startswith("--config=")]) == 5


@pytest.mark.parametrize("path", sorted(components.STAGES_DIR.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_stage_is_named_after_its_file(path: Path) -> None:
    stage = yaml.safe_load(path.read_text())
    assert (stage["kind"], stage["metadata"]["name"]) == ("Stage", path.stem)


def test_the_oracle_scores_every_node_without_a_rate_limit() -> None:
    config = yaml.safe_load(components.oracle_config(Path("/k")))
    assert config["percentageOfNodesToScore"] == 100
    assert config["leaderElection"] == {"leaderElect": False}
    assert config["clientConnection"]["qps"] >= 1000


def test_a_layout_makes_its_folders_and_takes_four_ports(tmp_path: Path) -> None:
    layout = Layout.create(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"bin", "logs", "certificates", "kubeconfigs"}
    assert len({layout.etcd_port, layout.etcd_peer_port, layout.api_port, layout.kwok_port}) == 4
