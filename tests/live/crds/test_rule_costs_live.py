"""The API server's own estimate of what the rules may cost, taken at our bounds and far beyond them.

`pytest --log-cli-level=INFO` on this file prints how far the bounds may grow and which rule is the first to cost too much.
"""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.support import crds

from robotapp_testbed import ControlPlane
from robotapp_testbed.failures import ApiStatusError

pytestmark = pytest.mark.live

logger = logging.getLogger(__name__)

DRY = "/apis/apiextensions.k8s.io/v1/customresourcedefinitions?dryRun=All"
BOUNDS = ("maxItems", "maxLength", "maxProperties")
FACTORS = (2, 3, 4, 8, 16)
MARGIN = 2
"""Rules that compare lists cost the product of their bounds: at twice the bounds at least four times as much."""


def scaled(node: Any, factor: int) -> Any:
    """A schema in which every bound on a size is `factor` times as large."""
    if isinstance(node, list):
        return [scaled(item, factor) for item in node]
    if not isinstance(node, dict):
        return node
    return {
        key: value * factor if key in BOUNDS and isinstance(value, int) else scaled(value, factor)
        for key, value in node.items()
    }


def refusals(plane: ControlPlane, definition: dict[str, Any]) -> Iterator[tuple[int, str]]:
    """Factor and the server's answer, empty while it accepts, up to the first factor it refuses."""
    spec = {**definition["spec"], "group": "costs.example"}
    for factor in FACTORS:
        body = {**definition, "metadata": {"name": f"{spec['names']['plural']}.costs.example"}, "spec": spec}
        try:
            plane.api.create(DRY, scaled(body, factor))
        except ApiStatusError as error:
            yield factor, error.message
            return
        yield factor, ""


@pytest.mark.parametrize("path", crds.FILES, ids=lambda path: path.stem)
def test_the_rules_stay_far_below_what_the_server_allows(control_plane: ControlPlane, path: Path) -> None:
    told = list(refusals(control_plane, yaml.safe_load(path.read_text())))
    accepted = [factor for factor, refusal in told if not refusal]
    factor, refusal = told[-1]
    logger.info(
        "%s: fits at %d times its bounds; at %d: %s", path.stem, max(accepted, default=1), factor, refusal or "fits"
    )
    assert all("cost" in text for _, text in told if text), "something other than the cost was refused"
    assert MARGIN in accepted
