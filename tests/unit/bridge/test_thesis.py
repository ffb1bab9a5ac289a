"""The Rigelfile listings of the thesis, as they are printed (tests/golden/thesis; docs/thesis.md names the deviations)."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from rigel_bridge.main import main

LISTINGS = Path(__file__).resolve().parents[2] / "golden" / "thesis"
IMAGE = ("--image", "acme/teleop:1", "--name", "teleop")


def rendered(capsys: pytest.CaptureFixture[str], listing: str, *flags: str) -> list[dict[str, Any]]:
    assert main(["render", str(LISTINGS / f"listing-{listing}.yaml"), *IMAGE, *flags]) == 0
    return list(yaml.safe_load_all(capsys.readouterr().out))


def test_listing_3_2_for_ros_1_deploys_roscore_as_before(capsys: pytest.CaptureFixture[str]) -> None:
    (app,) = rendered(capsys, "3.2-ros1")
    assert app["spec"] == {"ros": {"distro": "noetic"}, "components": [{"name": "ros-app", "image": "acme/teleop:1"}]}
    kinds = [(one["kind"], one["metadata"]["name"]) for one in rendered(capsys, "3.2-ros1", "--format", "manifests")]
    assert kinds == [
        ("Service", "teleop-ros-master"),
        ("Deployment", "teleop-ros-master"),
        ("Deployment", "teleop-ros-app"),
    ]


def test_listing_3_2_for_ros_2_has_no_master(capsys: pytest.CaptureFixture[str]) -> None:
    assert [one["kind"] for one in rendered(capsys, "3.2-ros2", "--format", "manifests")] == ["Deployment"]


def test_listing_3_12_is_the_whole_scheduler_block(capsys: pytest.CaptureFixture[str]) -> None:
    (app,) = rendered(capsys, "3.12", "--distro", "humble")
    assert app["spec"]["schedulerName"] == "kubernetes-scheduler"
    assert app["spec"]["placement"] == {"zones": ["edge-zone-1"]}
    (component,) = app["spec"]["components"]
    assert component["qosClass"] == "realtime"
    assert component["policies"] == {"latencyBudget": "30ms", "reliability": "reliable", "deadline": "50ms"}


def test_listing_3_3_is_what_the_pods_of_such_a_block_carry(capsys: pytest.CaptureFixture[str]) -> None:
    (deployment,) = rendered(capsys, "3.12", "--distro", "humble", "--format", "pods")
    template = deployment["spec"]["template"]
    policies = json.loads(template["metadata"]["annotations"]["scheduler.robotics.io/policies"])
    assert policies == {
        "latency_budget": "30ms",
        "qos_class": "realtime",
        "reliability": "reliable",
        "deadline": "50ms",
    }
    assert template["spec"]["schedulerName"] == "kubernetes-scheduler"


@pytest.mark.parametrize(
    ("sequence", "scheduler", "wishes"),
    [
        ("demo", "kubernetes-scheduler", True),
        ("benchmark_default", "default-scheduler", False),
        ("benchmark_custom", "kubernetes-scheduler", True),
    ],
)
def test_listing_4_1_chooses_the_scheduler_and_with_it_the_annotations(
    sequence: str, scheduler: str, wishes: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    block = str(LISTINGS / "listing-3.12.yaml")
    flags = ("--orchestration", block, "--distro", "humble", "--sequence", sequence)
    (app,) = rendered(capsys, "4.1", *flags)
    assert app["spec"]["schedulerName"] == scheduler
    assert ("policies" in app["spec"]["components"][0]) is wishes
    (deployment,) = rendered(capsys, "4.1", *flags, "--format", "pods")
    assert deployment["spec"]["template"]["spec"]["schedulerName"] == scheduler
    annotations = deployment["spec"]["template"]["metadata"].get("annotations", {})
    assert any(key.startswith("scheduler.robotics.io/") for key in annotations) is wishes


def test_listing_4_1_keeps_the_scheduler_out_of_the_image(capsys: pytest.CaptureFixture[str]) -> None:
    images = set()
    for sequence in ("demo", "benchmark_default"):
        flags = ("--orchestration", str(LISTINGS / "listing-3.12.yaml"), "--distro", "humble", "--sequence", sequence)
        images.add(rendered(capsys, "4.1", *flags)[0]["spec"]["components"][0]["image"])
    assert len(images) == 1


@pytest.mark.parametrize(
    ("requirement", "field", "expected"),
    [
        ("{type: gpu, model: nvidia}", "requires", {"type": "gpu", "model": "nvidia"}),
        ("{type: sensor, interface: usb-cam}", "requires", {"type": "sensor", "interface": "usb-cam"}),
        ("{type: can, interface: can0}", "devices", {"name": "can", "type": "can", "interface": "can0"}),
    ],
)
def test_the_hardware_of_section_4_4(
    requirement: str, field: str, expected: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "Rigelfile"
    block = f"{{scheduler: {{affinity: {{hardware_requirements: [{requirement}]}}}}}}"
    path.write_text(f"application: {{distro: humble}}\norchestration: {block}\n")
    assert main(["render", str(path), *IMAGE]) == 0
    assert yaml.safe_load(capsys.readouterr().out)["spec"]["components"][0][field] == [expected]


def test_a_listing_without_an_image_says_where_one_is_written(capsys: pytest.CaptureFixture[str]) -> None:
    path = LISTINGS / "listing-3.2-ros2.yaml"
    assert main(["render", str(path)]) == 72
    assert "names no image: write application_image" in capsys.readouterr().err


def test_what_stands_in_both_files_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    one, other = (str(LISTINGS / f"listing-{name}.yaml") for name in ("3.12", "3.2-ros2"))
    assert main(["render", one, "--orchestration", other]) == 72
    assert f"orchestration: is already in {one}:1: keep one" in capsys.readouterr().err
