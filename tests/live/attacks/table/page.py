"""The table of attacks in docs/security.md. `python -m tests.live.attacks.table.page` writes it anew."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from tests.live.attacks.table.attack import Attack
from tests.live.attacks.table.devices import CLAIMS, SLICES
from tests.live.attacks.table.escalations import FIELDS, REFERENCES, REVISIONS, RIGHTS, SERVICES
from tests.live.attacks.table.grants import OBJECTS, PODS, SPECS
from tests.live.attacks.table.host_access import matrix
from tests.live.attacks.table.sizes import SIZES
from tests.live.attacks.table.stolen_agents import AGENT, LABELLER

PAGE: Final = Path(__file__).resolve().parents[4] / "docs" / "security.md"
BEGIN: Final = "<!-- attacks: written by python -m tests.live.attacks.table.page -->"
END: Final = "<!-- end of attacks -->"
BEGIN_MATRIX: Final = "<!-- host access: written by python -m tests.live.attacks.table.page -->"
END_MATRIX: Final = "<!-- end of host access -->"
_WHO: Final = {
    "operator": "operator's token",
    "scheduler": "scheduler's token",
    "agent": "an agent's token",
    "labeller": "labeller's token",
    "kubelet": "a kubelet's credentials",
    "vendor": "another driver's token",
}
_SECTIONS: Final[Mapping[str, Sequence[Attack]]] = {
    "A RobotApp lends its writer an account, a Secret, a token or a priority": REFERENCES,
    "A RobotApp opens a port to the outside": SERVICES,
    "A RobotApp wants more than a component may have": FIELDS,
    "Somebody wants rights, or objects that are not his": RIGHTS,
    "A writer of RobotApps reaches the history of other workloads": REVISIONS,
    "A pod brings its own grant, or joins an app": PODS,
    "A RobotApp chooses its domain or its membership past the operator": SPECS,
    "A RobotApp is to fill the memory of our programs": SIZES,
    "Somebody writes claims, pools, telemetry or instances": OBJECTS,
    "The token of a node's agent is stolen": AGENT,
    "The token of the labeller is stolen": LABELLER,
    "Somebody promises devices of our driver in a ResourceSlice": SLICES,
    "Somebody takes, hides or frees devices of our driver": CLAIMS,
}


def table() -> str:
    """The sections with one row per attack."""
    return "\n".join(_section(title, attacks) for title, attacks in _SECTIONS.items())


def page(text: str) -> str:
    """The text of the page with the tables between their marks."""
    with_matrix = _between(text, BEGIN_MATRIX, matrix(), END_MATRIX)
    return _between(with_matrix, BEGIN, table(), END)


def _between(text: str, begin: str, table_text: str, end: str) -> str:
    before, _, rest = text.partition(begin)
    _, _, after = rest.partition(end)
    return f"{before}{begin}\n{table_text}{end}{after}"


def _section(title: str, attacks: Sequence[Attack]) -> str:
    rows = "".join(
        f"| {attack.text} | {_WHO.get(attack.who, attack.who)} | {attack.stop.words} | `{attack.key}` |\n"
        for attack in attacks
    )
    return f"### {title}\n| attack | as | what stops it | test |\n|---|---|---|---|\n{rows}"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text()))
