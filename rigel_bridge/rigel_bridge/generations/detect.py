"""Which generation a Rigelfile is, with the key and line that show it."""

from collections.abc import Mapping
from typing import Final

from rigel_bridge.document.failures import Exit, nearest
from rigel_bridge.document.tree import Node
from rigel_bridge.generations.model import Generation

TOP: Final[Mapping[Generation, tuple[str, ...]]] = {
    Generation.G1: ("packages", "deploy", "simulate", "vars", "orchestration", "sequences"),
    Generation.G2A: ("distro", "jobs", "packages", "sequences", "vars", "orchestration"),
    Generation.G2B: ("applications", "sequences", "vars", "orchestration"),
    Generation.G3: ("application", "jobs", "providers", "sequences", "vars"),
    Generation.THESIS: ("application", "jobs", "providers", "sequences", "vars", "orchestration"),
}
_EVERY: Final = sorted({key for keys in TOP.values() for key in keys})


def detect(root: Node) -> tuple[Generation, str]:
    """Generation and evidence; BridgeError that names the keys found when it is none, and for unknown keys."""
    if root.kind != "map":
        raise root.fail(
            f"expected a mapping, found {root.described()}; a Rigelfile has packages, or application and jobs"
        )
    top = root.mapping()
    generation, key = _detected(root, top)
    for name, node in top.items():
        if name not in TOP[generation]:
            known = [*TOP[generation]]
            raise node.fail(
                f"is not known in a Rigelfile of generation {generation}{nearest(name, known)}; known: {', '.join(known)}"
            )
    node = top[key]
    shape = {"seq": "a list", "map": "a mapping"}.get(node.kind, "there")
    return generation, f"{key} in line {node.place.line} is {shape}"


def _detected(root: Node, top: Mapping[str, Node]) -> tuple[Generation, str]:
    packages = top.get("packages")
    if packages is not None and packages.kind == "seq":
        for other in ("application", "applications", "jobs"):
            if other in top:
                raise top[other].fail(
                    f"belongs to another generation than the list of packages in line {packages.place.line}: keep one",
                    code=Exit.UNSUPPORTED,
                )
        return Generation.G1, "packages"
    if "applications" in top:
        return Generation.G2B, "applications"
    if packages is not None and packages.kind == "map" and "application" not in top:
        return Generation.G2A, "packages"
    if "distro" in top and "jobs" in top:
        return Generation.G2A, "distro"
    if "orchestration" in top:
        return Generation.THESIS, "orchestration"
    for key in ("application", "jobs"):
        if key in top:
            return Generation.G3, key
    if packages is not None:
        raise packages.fail(f"expected a list of packages, found {packages.described()}", code=Exit.UNSUPPORTED)
    found = ", ".join(f"{key}{nearest(key, _EVERY)}" if key not in _EVERY else key for key in top) or "nothing"
    raise root.fail(
        f"packages (Rigel 0.2), application and jobs (0.3), or orchestration is missing; found {found[:200]}",
        code=Exit.UNSUPPORTED,
    )
