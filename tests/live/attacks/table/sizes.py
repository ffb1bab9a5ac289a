"""A writer of RobotApps fills the memory of operator and scheduler: lists and texts beyond what the CRD admits.

What is within these bounds and large as a whole is not accepted by the operator (`TooLarge`): `scripts/bench hostile --only large-apps`.
"""

from typing import Any, Final

from tests.live.attacks.table import kinds
from tests.live.attacks.table.attack import Attack, Stop
from tests.live.attacks.table.kinds import app

from robotapp_api.model.app.parameters import INLINE_BYTES

_COMPONENT: Final = "spec.components[0]"
_POD: Final = f"{_COMPONENT}.template.spec"
_ITEMS: Final = "must have at most {} items"
_BYTES: Final = "may not be more than {} bytes|Too long"


def _oversize(key: str, text: str, path: str, value: Any, refusal: str) -> Attack:
    return Attack(key, text, "editor", kinds.ROBOTAPP, app(), {path: value}, Stop.RULE, says=refusal)


def _containers(count: int) -> list[dict[str, str]]:
    return [{"name": f"c{number}", "image": "ros:humble"} for number in range(count)]


SIZES: Final = (
    _oversize("size-components", "65 components", "spec.components", _containers(65), _ITEMS.format(64)),
    _oversize(
        "size-edges",
        "257 edges",
        "spec.edges",
        [{"topic": f"/t{number}", "from": "driver", "to": "driver"} for number in range(257)],
        _ITEMS.format(256),
    ),
    _oversize(
        "size-environment",
        "129 variables of one component",
        f"{_COMPONENT}.env",
        [{"name": f"A{number}", "value": ""} for number in range(129)],
        _ITEMS.format(128),
    ),
    _oversize(
        "size-init-containers",
        "nine init containers of one component",
        f"{_POD}.initContainers",
        _containers(9),
        _ITEMS.format(8),
    ),
    _oversize(
        "size-volumes",
        "65 volumes of one component",
        f"{_POD}.volumes",
        [{"name": f"v{number}", "emptyDir": {}} for number in range(65)],
        _ITEMS.format(64),
    ),
    _oversize(
        "size-value",
        "a variable of 40 kB",
        f"{_COMPONENT}.env",
        [{"name": "A", "value": "x" * 40_000}],
        _BYTES.format(32_768),
    ),
    _oversize(
        "size-inline",
        "a parameter file one byte longer than 64 KiB",
        f"{_COMPONENT}.parameters",
        [{"inline": "a: " + "x" * (INLINE_BYTES - 2)}],
        _BYTES.format(INLINE_BYTES),
    ),
    _oversize(
        "size-annotation",
        "an annotation of the pods of 5 kB",
        f"{_COMPONENT}.template.metadata.annotations",
        {"example.com/a": "x" * 5_000},
        _BYTES.format(4_096),
    ),
)
"""By the kind of list or text."""
