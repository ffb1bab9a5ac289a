"""ROS version, domain, middleware and master."""

import re
from collections.abc import Mapping
from typing import Any, Final

from rigel_bridge.document.distros import distros, remark
from rigel_bridge.document.failures import BridgeError, Place, nearest
from rigel_bridge.document.section import Section
from rigel_bridge.document.tree import Node
from rigel_bridge.generations.model import Package
from rigel_bridge.names import MAX_DOMAIN
from rigel_bridge.render import scheduling
from rigel_bridge.render.draft import Draft
from rigel_bridge.render.notes import Note

LIFTED: Final = {"RMW_IMPLEMENTATION": "rmw", "ROS_DOMAIN_ID": "domain"}
"""Variables of ROS 2 that belong to the RobotApp's `ros2`: all components share them and the operator writes them."""
ADDRESSES: Final = ("ROS_MASTER_URI", "ROS_IP", "ROS_HOSTNAME")
"""Variables of ROS 1 that the operator writes: its master, and the pod's own address."""
OWN_MASTER: Final = re.compile(r"https?://(ros-master|localhost|127\.0\.0\.1)(\.[^:/]*)?(:11311)?/?")
"""Where Rigel's orchestration plugin puts the master of an app; a RobotApp's has a name of its own."""


def ros(packages: tuple[Package, ...], block: Section | None, draft: Draft, *, today: str) -> list[Note]:
    """Fill `ros`, `ros1` and `ros2`; gives notes. `today` as 2026-05-22; empty for no remarks about ends of life."""
    for package in packages:
        if package.distro:
            draft.put(("ros", "distro"), package.distro, package.node)
    distro, at = _distro(packages, block, draft)
    version = _version(distro, at, block, draft)
    notes = [Note(f"{at.place}: {found}") for found in [_remark(distro, today)] if found]
    if version == 2:
        for package in packages:
            for variable in LIFTED:
                _refuse_from_base(variable, package)
                lift(variable, package.env.values.get(variable), package.node, draft)
        notes += _unused_master(block, distro)
        return notes
    notes += [
        Note(f"{package.node.place}: env {variable} has no meaning for ROS 1 ({distro}) and is left out")
        for package in packages
        for variable in LIFTED
        if variable in package.env.values
    ]
    if block is not None:
        _master(block, draft)
    return notes


def _refuse_from_base(variable: str, package: Package) -> None:
    if reference := package.env.from_base.get(variable):
        raise package.node.fail(
            f"env {variable} refers to {reference}, which only the base image states: write the value itself"
        )


def lift(variable: str, value: str | None, node: Node, draft: Draft) -> None:
    """One variable that the app has a field for."""
    if value is None:
        return
    field = LIFTED[variable]
    if field == "domain" and not scheduling.DOMAIN.fullmatch(value):
        raise node.fail(f"env {variable} must be a number from 0 to {MAX_DOMAIN}, found {value[:80]!r}")
    draft.put(("ros2", field), int(value) if field == "domain" else value, node)


def _distro(packages: tuple[Package, ...], block: Section | None, draft: Draft) -> tuple[str, Node]:
    """The packages' distro, else the one that the block's RobotApp words give, for images that others built."""
    verbatim = block.section("robotapp") if block else None
    stated = verbatim.section("ros") if verbatim else None
    node = stated.get("distro") if stated else None
    written: str | None = draft.spec.get("ros", {}).get("distro")
    if written is None and stated and node:
        return stated.text_of(node), node
    if written is None:
        raise BridgeError(
            draft.place,
            "no package names its ROS distro: write robotapp: {ros: {distro: …}} in the orchestration block, or give --distro",
        )
    return written, next((package.node for package in packages if package.distro), packages[0].node)


def _version(distro: str, at: Node, block: Section | None, draft: Draft) -> int:
    """Never guessed: an unknown distribution needs `ros_version`."""
    stated = block.number("ros_version") if block else None
    known = distros().get(distro)
    if stated is not None and stated not in (1, 2):
        raise ((block.get("ros_version") if block else None) or at).fail("must be 1 or 2")
    if known is None and stated is None and distro.startswith("$"):
        raise at.fail(
            f"{distro[:80]!r} is a mark of `rigel init`, which Rigel does not replace either: write the name, such as jazzy"
        )
    if known is None and stated is None:
        hint = nearest(distro.lower(), list(distros()))
        raise at.fail(
            f"{distro[:80]!r} is no ROS distribution that we know{hint}; "
            "for a newer one write ros_version: 1 or 2 into the orchestration block"
        )
    if known is not None and stated not in (None, known.version):
        raise at.fail(f"{distro} is ROS {known.version}, and ros_version is {stated}: leave ros_version out")
    if known is None and block and (node := block.get("ros_version")):
        draft.put(("ros", "version"), stated, node)
    return known.version if known else stated or 2


def _remark(distro: str, today: str) -> str:
    known = distros().get(distro)
    if known is None:
        return f"{distro} is not known to this version of rigel-bridge, nor to its operator"
    return remark(known, today) if today else ""


def _unused_master(block: Section | None, distro: str) -> list[Note]:
    node = block.get("deploy_ros_master") if block and block.flag("deploy_ros_master") else None
    if node is None:
        return []
    return [
        Note(
            f"{node.place}: deploy_ros_master has no meaning for ROS 2 ({distro}), which has no master: none is deployed"
        )
    ]


def _master(block: Section, draft: Draft) -> None:
    if image := block.get("ros_master_image"):
        draft.put(("ros1", "image"), block.text_of(image), image)
    node = block.get("deploy_ros_master")
    if node and block.flag("deploy_ros_master") is False:
        draft.put(("ros1", "master"), "External", node)


def settle_addresses(block: Section | None, draft: Draft, *, version: int) -> list[Note]:
    """Take master and addresses out of the components' variables, which the operator would refuse; gives notes."""
    notes: list[Note] = []
    for index, component in enumerate(draft.spec["components"]):
        env = component.get("env")
        if not isinstance(env, list):
            continue
        taken = [entry for entry in env if isinstance(entry, dict) and entry.get("name") in ADDRESSES]
        place = draft.origin(("components", index, "env"))
        for entry in taken:
            if version == 1 and entry["name"] == "ROS_MASTER_URI":
                _master_elsewhere(entry, place, block, draft)
            notes.append(_left_out(entry["name"], place, version=version))
        if taken:
            component["env"] = [entry for entry in env if entry not in taken]
        if not component["env"]:
            del component["env"]
    return notes


def _left_out(variable: str, place: Place, *, version: int) -> Note:
    left = f"{place}: env {variable} is left out"
    if version != 1:
        return Note(f"{left}: ROS 2 does not read it")
    return Note(
        f"{left}: the operator sets it",
        plain=f"{left}: each pod gets ROS_MASTER_URI and ROS_IP, the addresses of its master and of itself",
    )


def _master_elsewhere(entry: Mapping[str, Any], place: Place, block: Section | None, draft: Draft) -> None:
    """A master that is not the app's own becomes `ros1.uri`."""
    uri = entry.get("value")
    if isinstance(uri, str) and OWN_MASTER.fullmatch(uri):
        return
    managed = block is not None and block.flag("deploy_ros_master")
    if managed or not isinstance(uri, str) or not uri.startswith("http://"):
        raise BridgeError(
            place,
            "env ROS_MASTER_URI names another master than the app's own; for that one write deploy_ros_master: false and "
            "robotapp: {ros1: {uri: 'http://…:11311'}}, for the app's own leave the variable out",
        )
    stated = draft.spec.setdefault("ros1", {})
    if stated.setdefault("uri", uri) != uri:
        raise BridgeError(
            place, f"env ROS_MASTER_URI is {uri[:80]!r}, and spec.ros1.uri is {stated['uri']!r}: keep one"
        )
    stated["master"] = "External"
