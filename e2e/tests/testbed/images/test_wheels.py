"""Locked wheels as image content."""

from robotapp_testbed.images import wheels
from robotapp_testbed.images.pythonic import Component, Ros2, Ros2Jazzy


def test_requirements_are_those_of_the_lock_file_with_hashes() -> None:
    text = wheels.requirements("--no-dev", "--extra", "operator")
    assert "kopf==" in text
    assert "numpy" not in text
    assert text.count("--hash=sha256:") > 10
    assert "cyclonedds==11" in wheels.requirements(*Ros2.selection)
    assert "ros-jazzy-rclpy==7.1" in wheels.requirements(*Ros2Jazzy.selection)


def test_our_wheel_is_made_from_all_its_packages_and_the_project_file() -> None:
    names = {path.name for path in wheels.sources()}
    folders = {part for path in wheels.sources() for part in path.parts}
    assert {"pyproject.toml", "README.md"} <= names
    assert {
        "robotapp_api",
        "robotapp_client",
        "robotapp_claims",
        "robotapp_operator",
        "robotapp_scheduler",
        "robotapp_cli",
        "rigel_bridge",
    } <= folders
    assert "__pycache__" not in folders


def test_components_start_like_their_dockerfiles_say() -> None:
    for name in ("operator", "scheduler"):
        config = Component(name).config()
        assert config.entrypoint == ("/usr/bin/python3", "-m", f"robotapp_{name}")
        assert config.user == "65532:65532"
