"""package.xml: catkin_pkg on checked bytes; where it refuses a manifest, what can be told is read nevertheless."""

import re
import warnings
from typing import Any, Final

from catkin_pkg.package import InvalidPackage, parse_package_string

from ros_profile.model.facts import Problem
from ros_profile.model.package import Dependency, Export, Manifest
from ros_profile.read import xml_text

MAX_BYTES: Final = 256 << 10
NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,213}")
"""What becomes part of labels and annotations; wider than the rule for new packages, as old ones have dashes."""
_KINDS: Final = {
    "depend": ("build", "build_export", "exec"),
    "build_depend": ("build",),
    "build_export_depend": ("build_export",),
    "buildtool_depend": ("buildtool",),
    "buildtool_export_depend": ("buildtool",),
    "run_depend": ("build_export", "exec"),
    "exec_depend": ("exec",),
    "test_depend": ("test",),
    "doc_depend": ("doc",),
}
_ATTRIBUTES: Final = (
    ("build_depends", "build"),
    ("build_export_depends", "build_export"),
    ("buildtool_depends", "buildtool"),
    ("exec_depends", "exec"),
    ("test_depends", "test"),
    ("doc_depends", "doc"),
)


def read_manifest(data: bytes, file: str = "package.xml") -> tuple[Manifest | None, tuple[Problem, ...]]:
    """The manifest, or None with the reason."""
    root = xml_text.parse(data, most=MAX_BYTES)
    if isinstance(root, xml_text.Unreadable):
        return None, (Problem(file, root.message, root.line),)
    if xml_text.tag_of(root) != "package":
        return None, (Problem(file, f"is no package manifest: its root is <{xml_text.tag_of(root)[:40]}>", 1),)
    name = (root.findtext("name") or "").strip()
    if not NAME.fullmatch(name):
        return None, (
            Problem(file, f"{name[:80]!r} is no package name; allowed: letters, digits and _, first a letter"),
        )
    version = _ros_version(root)
    kinds, problems = _by_catkin(data, file, version)
    tolerant = kinds is None
    manifest = Manifest(
        name=name,
        version=_text(root, "version")[:40],
        description=" ".join("".join(root.find("description").itertext()).split())[:2000]
        if root.find("description") is not None
        else "",
        build_type=_build_type(root),
        ros_version=version,
        dependencies=_dependencies(root, kinds, version),
        exports=_exports(root),
        file=file,
        tolerant=tolerant,
    )
    return manifest, problems


def _text(root: Any, tag: str) -> str:
    return (root.findtext(tag) or "").strip()


def _build_type(root: Any) -> str:
    stated = [(t.text or "").strip() for t in root.findall("export/build_type") if _holds(t.get("condition", ""), "2")]
    return stated[0] if stated else ""


def _ros_version(root: Any) -> int:
    """1 or 2 from build type and build tools; 0 where both are listed under conditions."""
    words = [(e.text or "").strip() for e in root.findall("export/build_type") + root.findall("buildtool_depend")]
    words += [(e.text or "").strip() for e in root if xml_text.tag_of(e) in _KINDS]
    ros2 = any(w.startswith(("ament_", "rclcpp", "rclpy", "rosidl_")) or w == "ros_workspace" for w in words)
    ros1 = any(w in ("catkin", "roscpp", "rospy", "rosbuild") for w in words)
    return 0 if ros1 == ros2 else 2 if ros2 else 1


def _by_catkin(data: bytes, file: str, version: int) -> tuple[dict[str, list[str]] | None, tuple[Problem, ...]]:
    """Kinds by dependency, conditions evaluated; None when catkin_pkg does not accept the manifest."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # catkin_pkg calls pyparsing by its old names
            package = parse_package_string(data, filename=file, warnings=[])
            package.evaluate_conditions(_context(version))
    except (InvalidPackage, AssertionError, ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        reason = " ".join(str(error).split())[:300]
        return None, (Problem(file, f"is not valid, read as far as it goes: {reason}"),)
    kinds: dict[str, list[str]] = {}
    for attribute, kind in _ATTRIBUTES:
        for dependency in getattr(package, attribute):
            if dependency.evaluated_condition is not False:
                kinds.setdefault(dependency.name, []).append(kind)
    return kinds, ()


def _context(version: int) -> dict[str, str]:
    return {
        "ROS_VERSION": "1" if version == 1 else "2",
        "ROS_DISTRO": "noetic" if version == 1 else "jazzy",
        "ROS_PYTHON_VERSION": "3",
    }


def _holds(condition: str, version: str) -> bool:
    """The one condition that tolerant reading understands: the ROS version."""
    found = re.search(r"\$ROS_VERSION\s*==\s*['\"]?([12])", condition)
    return found is None or found[1] == version


def _dependencies(root: Any, kinds: dict[str, list[str]] | None, version: int) -> tuple[Dependency, ...]:
    """In the order of the file, with lines. Without catkin_pkg's reading the tags themselves give the kinds."""
    lines: dict[str, int] = {}
    tolerant: dict[str, list[str]] = {}
    for element in root:
        tag, name = xml_text.tag_of(element), (element.text or "").strip()
        if tag not in _KINDS or not 0 < len(name) <= 100:
            continue
        if _holds(element.get("condition", ""), "1" if version == 1 else "2"):
            tolerant.setdefault(name, []).extend(_KINDS[tag])
            lines.setdefault(name, xml_text.line_of(element))
    known = tolerant if kinds is None else kinds
    found = [
        Dependency(name, tuple(dict.fromkeys(k)), lines.get(name, 0)) for name, k in known.items() if len(name) <= 100
    ]
    return tuple(sorted(found, key=lambda d: (d.line, d.name)))


def _exports(root: Any) -> tuple[Export, ...]:
    return tuple(
        Export(
            tag=xml_text.tag_of(element),
            text=(element.text or "").strip()[:500],
            attributes=tuple((str(k), str(v)[:500]) for k, v in element.attrib.items()),
            line=xml_text.line_of(element),
        )
        for element in root.iterfind("export/*")
        if xml_text.tag_of(element)
    )
