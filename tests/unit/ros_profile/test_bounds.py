"""Nothing outside the package is read, nothing hangs, nothing raises: folders and manifests made to do harm."""

import os
from pathlib import Path

import pytest
from tests.support.ros_sources import loaded, manifest, package, write

from campaigns.profile.profile_hostile import watched
from ros_profile.files import walk
from ros_profile.files.load import load
from ros_profile.generate import generate_profile
from ros_profile.read import yaml_text
from ros_profile.read.manifest import read_manifest


def test_links_out_of_the_package_are_not_followed_and_loops_end(tmp_path: Path) -> None:
    outside = write(
        tmp_path / "outside", {"secret.py": "import serial\nserial.Serial('/dev/ttyUSB0')\n", "deep/x.yaml": "a: 1\n"}
    )
    inside = package(tmp_path / "ws", "linked", {"src/good.py": "import rospy\n"})
    (inside / "src/stolen.py").symlink_to(outside / "secret.py")
    (inside / "src/up.py").symlink_to("../../../outside/secret.py")
    (inside / "src/folder").symlink_to(outside / "deep")
    (inside / "src/loop").symlink_to(inside)
    (inside / "src/self.py").symlink_to("self.py")
    (inside / "src/alias.py").symlink_to("good.py")
    load(tmp_path / "ws")  # once, so that nothing is imported later
    with watched(tmp_path / "ws") as watch:
        found = load(tmp_path / "ws").packages[0]
    assert [source.file for source in found.sources] == ["src/alias.py", "src/good.py"]
    assert {problem.file for problem in found.problems} == {"src/stolen.py", "src/up.py", "src/self.py"}
    assert (watch.found, watch.opened > 0) == ([], True)


def test_pipes_devices_and_folders_with_names_of_files_do_not_hang(tmp_path: Path) -> None:
    folder = package(tmp_path, "odd", {"b.py/inner.txt": "x"})
    os.mkfifo(folder / "a.py")
    found = loaded(tmp_path)["odd"]
    assert [problem.message for problem in found.problems] == ["is no regular file"]


def test_large_files_are_left_out_by_name(tmp_path: Path) -> None:
    package(tmp_path, "big", {"data.py": b"x = 1\n" * 1_000_000, "long.py": b"x = '" + b"a" * 100_000 + b"'\n"})
    found = loaded(tmp_path)["big"]
    assert [problem.file for problem in found.problems] == ["data.py", "long.py"]


def test_the_folder_as_a_whole_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package(tmp_path, "wide", {f"m{index}.py": "" for index in range(20)})
    monkeypatch.setattr(walk, "MAX_FILES", 10)
    found = loaded(tmp_path)["wide"]
    assert len(found.sources) == 10
    assert "more than 10 files" in found.problems[0].message


@pytest.mark.parametrize("marker", walk.IGNORE_MARKERS)
def test_ignore_markers_build_folders_and_tests_are_left_out(tmp_path: Path, marker: str) -> None:
    package(tmp_path / "src", "kept", {"test/test_a.py": "", "third_party/x.py": "", "pkg/a.py": ""})
    write(package(tmp_path / "src/off", "ignored", {}).parent, {marker: ""})
    package(tmp_path / "install", "built", {})
    assert {name: [s.file for s in one.sources] for name, one in loaded(tmp_path).items()} == {"kept": ["pkg/a.py"]}


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b'<!DOCTYPE a SYSTEM "file:///etc/passwd"><package/>', "DOCTYPE"),
        (b'<!DOCTYPE a [<!ENTITY x "y">]><package><name>&x;</name></package>', "DOCTYPE"),
        (b"<package>" + b"<a>" * 200, "100 levels"),
        (b"<package>" + b" " * 300_000 + b"</package>", "at most"),
        (b"<html/>", "no package manifest"),
        (b"", "is not XML"),
        (b"\xff\xfe<", "is not XML"),
        (b"<package><name>../evil</name></package>", "no package name"),
        (b"<package><name>a\nb</name></package>", "no package name"),
    ],
)
def test_manifests_that_cannot_be_used_have_a_reason(data: bytes, reason: str) -> None:
    found, problems = read_manifest(data)
    assert found is None
    assert reason in problems[0].message


def test_a_manifest_catkin_refuses_is_read_as_far_as_it_goes() -> None:
    text = manifest("loose", depends=("rclpy",)).replace("<license>MIT</license>", "<unheard_of/>")
    found, problems = read_manifest(text.encode())
    assert found is not None
    assert (found.name, found.tolerant, found.depends("exec")) == ("loose", True, {"rclpy"})
    assert "read as far as it goes" in problems[0].message


def test_conditions_of_the_other_ros_version_do_not_count() -> None:
    more = '<depend condition="$ROS_VERSION == 1">roscpp</depend><depend condition="$ROS_VERSION == 2">rclcpp</depend>'
    for tolerant in ("", "<bad_tag/>"):
        found, _ = read_manifest(manifest("both", depends=("rclcpp",), more=more + tolerant).encode())
        assert found is not None
        assert found.depends("exec") == {"rclcpp"}


@pytest.mark.parametrize("prefix", [b"", b"\xef\xbb\xbf", b'<?xml version="1.0" encoding="UTF-8"?>\r\n'])
def test_marks_and_line_ends_of_manifests_do_not_matter(prefix: bytes) -> None:
    found, problems = read_manifest(prefix + manifest("marked").replace("><", ">\r\n<").encode())
    assert found is not None
    assert problems == ()


def test_yaml_has_no_aliases_no_tags_and_says_what_stands_twice() -> None:
    bomb = "a: &a [x, x]\nb: &b [*a, *a]\nc: !!python/object/apply:os.system [id]\nc: 2\n"
    root, problems = yaml_text.parse(bomb.encode(), "x.yaml")
    assert root is not None
    assert {problem.message.split()[0] for problem in problems} == {"alias", "key"}
    assert [node.text for _, node in yaml_text.scalars(root)] == ["[x, x]", "[, ]", "[id]", "2"]
    deep, problems = yaml_text.parse(b"[" * 1000, "x.yaml")
    assert "nested deeper" in problems[0].message or deep is not None


def test_what_is_no_folder_is_an_os_error_and_an_empty_one_has_no_package(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        generate_profile(tmp_path / "missing")
    with pytest.raises(NotADirectoryError):
        generate_profile(write(tmp_path, {"a.txt": ""}) / "a.txt")
    assert generate_profile(tmp_path).packages == ()


def test_the_cache_gives_the_same_and_forgives_damage(tmp_path: Path) -> None:
    folder = package(tmp_path / "ws", "kept", {"a.py": "import rospy\nrospy.Publisher('a', String)\n"})
    cache = tmp_path / "cache"
    first = load(tmp_path / "ws", cache=cache)
    assert load(tmp_path / "ws", cache=cache) == first
    for file in cache.iterdir():
        file.write_bytes(b"\x93damaged")
    assert load(tmp_path / "ws", cache=cache) == first
    write(folder, {"a.py": "import rospy\nrospy.Publisher('b', String)\n"})
    assert load(tmp_path / "ws", cache=cache).packages[0].sources[0].endpoints[0].name == "b"


def test_the_last_profile_is_taken_as_long_as_nothing_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from ros_profile import generate

    folder = package(tmp_path / "ws", "kept", {"a.py": "import rospy\nrospy.Publisher('a', String)\n"})
    made: list[str] = []
    real = generate.profile
    monkeypatch.setattr(generate, "profile", lambda *given, **more: made.append("") or real(*given, **more))
    first = generate_profile(tmp_path / "ws", cache=tmp_path / "cache")
    assert generate_profile(tmp_path / "ws", cache=tmp_path / "cache") == first
    assert len(made) == 1
    generate_profile(tmp_path / "ws", cache=tmp_path / "cache", engine="thesis")
    write(folder, {"package.xml": manifest("renamed")})
    assert generate_profile(tmp_path / "ws", cache=tmp_path / "cache").packages[0].name == "renamed"
    (folder / "a.py").unlink()
    assert generate_profile(tmp_path / "ws", cache=tmp_path / "cache").packages[0].executables == ()
    assert len(made) == 4


def test_a_cache_that_others_can_write_is_not_believed(tmp_path: Path) -> None:
    """XDG_CACHE_HOME in a shared folder: a planted profile would decide where pods run."""
    package(tmp_path / "ws", "kept", {"a.py": "import rospy\nrospy.Publisher('a', String)\n"})
    cache = tmp_path / "cache"
    first = generate_profile(tmp_path / "ws", cache=cache)
    (last,) = cache.glob("*.profile")
    planted = last.read_bytes().replace(b"kept", b"evil")
    last.write_bytes(planted)
    assert generate_profile(tmp_path / "ws", cache=cache).packages[0].name == "evil", "our own files are believed"
    last.chmod(0o666)
    assert generate_profile(tmp_path / "ws", cache=cache) == first
    last.unlink()
    elsewhere = write(tmp_path, {"planted": ""}) / "planted"
    elsewhere.write_bytes(planted)
    last.symlink_to(elsewhere)
    assert generate_profile(tmp_path / "ws", cache=cache) == first
    assert elsewhere.read_bytes() == planted, "the link gave way, its target is as it was"
    last.unlink()
    os.mkfifo(last)
    assert generate_profile(tmp_path / "ws", cache=cache) == first


def test_files_of_another_user_are_not_believed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package(tmp_path / "ws", "kept", {"a.py": "import rospy\nrospy.Publisher('a', String)\n"})
    cache = tmp_path / "cache"
    first = generate_profile(tmp_path / "ws", cache=cache)
    (last,) = cache.glob("*.profile")
    last.write_bytes(last.read_bytes().replace(b"kept", b"evil"))
    monkeypatch.setattr(os, "geteuid", lambda: last.stat().st_uid + 1)
    assert generate_profile(tmp_path / "ws", cache=cache) == first
