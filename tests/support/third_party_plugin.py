"""A plugin as somebody outside the project writes it; named in configurations as module:Class."""

from typing import Any


class PreferQuietNodes:
    """Fewer pods, more points."""

    name = "PreferQuietNodes"
    normalize = "inverse"
    reads = ("namespace",)
    node_reads = ("pods",)

    def score(self, _pod: Any, nodes: Any) -> Any:
        return nodes.pod_count.astype(float)
