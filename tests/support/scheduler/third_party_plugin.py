"""A plugin as somebody outside the project writes it; named in configurations as module:Class."""

from typing import Any

import msgspec


class Wishes(msgspec.Struct):
    """Its arguments."""

    quiet: str = "a bit"


class PreferQuietNodes:
    """Fewer pods, more points."""

    name = "PreferQuietNodes"
    Args = Wishes
    reads = ()
    node_reads = ("requested",)
    normalize = "minmax"

    def __init__(self, args: Wishes) -> None:
        self.quiet = args.quiet

    def score(self, _pod: Any, nodes: Any) -> Any:
        return nodes.free("cpu")
