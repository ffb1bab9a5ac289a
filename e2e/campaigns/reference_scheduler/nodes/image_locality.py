"""ImageLocality: bytes of the pod's images a node already has, spread images counting for more."""

from campaigns.reference_scheduler.model import Json
from campaigns.reference_scheduler.state import State, name_of

_MIB = 1024 * 1024
_FLOOR = 23 * _MIB
_CEILING_PER_IMAGE = 1000 * _MIB


def image_score(state: State, feasible: list[Json]) -> dict[str, int]:
    """Raw, and final: already 0…100."""
    images = [_normal(image) for image in _images(state)]
    ceiling = _CEILING_PER_IMAGE * len(images)
    found = {}
    for node in feasible:
        sizes = _on(node)
        total = sum(_scaled(state, image, sizes[image]) for image in images if image in sizes)
        total = max(_FLOOR, min(total, ceiling))
        found[name_of(node)] = 100 * (total - _FLOOR) // (ceiling - _FLOOR)
    return found


def _scaled(state: State, image: str, size: int) -> int:
    having = sum(1 for node in state.nodes if image in _on(node))
    return int(float(size) * (float(having) / float(len(state.nodes))))


def _images(state: State) -> list[str]:
    spec = state.pod["spec"]
    found = [container["image"] for container in [*(spec.get("initContainers") or []), *spec["containers"]]]
    if state.config.compat_version != "1.35":
        found += [volume["image"]["reference"] for volume in spec.get("volumes") or [] if volume.get("image")]
    return found


def _on(node: Json) -> dict[str, int]:
    return {
        name: int(image.get("sizeBytes") or 0)
        for image in (node.get("status") or {}).get("images") or []
        for name in image.get("names") or []
    }


def _normal(image: str) -> str:
    """Without a tag `:latest` is meant; a digest has its colon after the last slash too and stays."""
    return image if image.rfind(":") > image.rfind("/") else f"{image}:latest"
