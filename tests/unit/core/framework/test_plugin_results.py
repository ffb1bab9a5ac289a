import numpy as np
import pytest

from robotapp_scheduler.core.framework.interface import PluginError
from robotapp_scheduler.core.framework.plugin_results import normalized


@pytest.mark.parametrize(
    ("how", "raw", "expected"),
    [
        ("max", [0, 5, 10], [0, 50, 100]),
        ("max", [0, 0], [0, 0]),
        ("max", [1, 3], [33, 100]),
        ("inverse", [0, 1, 3], [100, 67, 0]),
        ("inverse", [0, 0], [100, 100]),
        ("minmax", [0, 29, 100], [0, 28, 100]),  # dividing first, as upstream
        ("minmax", [7, 7], [0, 0]),
        ("none", [12, 99], [12, 99]),
        ("none", [12.9, 0.1], [12, 0]),
    ],
)
def test_normalising_equals_upstreams_integers(how: str, raw: list[float], expected: list[int]) -> None:
    assert normalized("P", how, np.array(raw)).tolist() == expected


def test_a_normalised_score_outside_0_to_100_names_the_plugin() -> None:
    with pytest.raises(PluginError, match="plugin P: returns an invalid score 120"):
        normalized("P", "none", np.array([120]))
