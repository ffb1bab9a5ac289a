"""A plugin with a mistake everybody makes once: one score instead of one per node."""

from typing import Any

import numpy as np


class ScoresOfOne:
    name = "ScoresOfOne"
    reads = ()

    def score(self, _pod: Any, _nodes: Any) -> Any:
        return np.array([1])
