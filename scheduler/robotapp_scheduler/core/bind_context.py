"""What plugins hand each other, and the pod, between the choice of a node and the bind."""


class BindContext:
    """One attempt to bind a pod. `annotations` go into the Binding, so the pod has them the moment it is bound.

    `kept` is for the plugin's own use, from `reserve` to `post_bind`.
    """

    __slots__ = ("annotations", "kept")

    def __init__(self) -> None:
        self.annotations: dict[str, str] = {}
        self.kept: dict[str, object] = {}

    def __repr__(self) -> str:
        return f"BindContext({self.annotations})"
