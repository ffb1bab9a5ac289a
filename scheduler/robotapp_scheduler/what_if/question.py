"""The body of POST /what-if: lost nodes, other round trips, apps that are not there, another configuration."""

from collections.abc import Collection
from difflib import get_close_matches
from typing import Any, Final

import msgspec

from robotapp_api.model.names import API_VERSION
from robotapp_api.values.arguments import is_name, not_a_name
from robotapp_api.values.quantities.duration import parse_us

MOST_BODY: Final = 1 << 20
MOST_NODES, MOST_PAIRS, MOST_APPS = 50, 50, 10
MOST_REPLAYED: Final = 500
_EXAMPLE: Final = (
    '{"nodeLoss": ["edge-1"], "rtt": [{"one": "edge-1", "other": "amr-07", "rtt": "40ms"}], "apps": [], "config": null}'
)
_FORM: Final = f"the body is JSON such as {_EXAMPLE}"


class QuestionError(Exception):
    """The question cannot be answered; the text says what is wrong with it, where, and what is allowed."""


class UnknownNodeError(QuestionError):
    """It names a node that is not there."""


class RoundTrip(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The round-trip time of a pair of nodes."""

    one: str
    other: str
    rtt: str

    @property
    def us(self) -> int:
        """Microseconds."""
        return parse_us(self.rtt)


class Question(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """All of it at once: `node_loss` names nodes, `apps` are RobotApps, `config` a KubeSchedulerConfiguration.

    `replay`: nothing else is asked, and so many of the latest placements are judged with `config`.
    """

    node_loss: tuple[str, ...] = ()
    rtt: tuple[RoundTrip, ...] = ()
    apps: tuple[dict[str, Any], ...] = ()
    config: dict[str, Any] | None = None
    replay: int = 0

    @property
    def nodes(self) -> list[str]:
        """The nodes it names, each once."""
        return list(dict.fromkeys([*self.node_loss, *(end for pair in self.rtt for end in (pair.one, pair.other))]))

    @property
    def names(self) -> list[tuple[str, str]]:
        """Namespace and name of each of its apps."""
        return [(app["metadata"]["namespace"], app["metadata"]["name"]) for app in self.apps]


def parse(body: bytes) -> Question:
    """The question of a body of at most MOST_BODY bytes. Raises QuestionError."""
    if len(body) > MOST_BODY:
        raise QuestionError(f"the body has more than {MOST_BODY >> 20} MiB")
    try:
        question = msgspec.json.decode(body, type=Question)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise QuestionError(f"{_FORM}; {error}") from error
    if not (question.node_loss or question.rtt or question.apps or question.config):
        raise QuestionError(f"nothing is asked; {_FORM}")
    _check_replay(question)
    for field, asked, most in (
        ("nodeLoss", question.node_loss, MOST_NODES),
        ("rtt", question.rtt, MOST_PAIRS),
        ("apps", question.apps, MOST_APPS),
    ):
        if len(asked) > most:
            raise QuestionError(f"{field} has {len(asked)} entries, at most {most} are allowed")
    for number, pair in enumerate(question.rtt):
        _check_pair(f"rtt[{number}]", pair)
    for number, app in enumerate(question.apps):
        _check_app(f"apps[{number}]", app)
    for name in question.names:
        if question.names.count(name) > 1:
            raise QuestionError(f"RobotApp {'/'.join(name)} is given twice")
    return question


def check_nodes(question: Question, known: Collection[str]) -> None:
    """Raises UnknownNodeError where the question names a node that is not there."""
    for name in question.nodes:
        if name not in known:
            close = get_close_matches(name, known, n=3)
            hint = f"did you mean {' or '.join(close)}?" if close else "kubectl robotapp nodes lists them"
            raise UnknownNodeError(f"there is no node {name[:253]!r} among {len(known)}: {hint}")


def _check_replay(question: Question) -> None:
    if not 0 <= question.replay <= MOST_REPLAYED:
        raise QuestionError(f"replay is {question.replay}: from 0 to {MOST_REPLAYED} placements can be judged")
    if question.replay and (question.config is None or question.nodes or question.apps):
        raise QuestionError(
            "replay judges placements with a config, and with nothing else: leave nodeLoss, rtt and apps out"
        )


def _check_pair(where: str, pair: RoundTrip) -> None:
    if pair.one == pair.other:
        raise QuestionError(f"{where} names {pair.one} twice: a pair has two different nodes")
    try:
        parse_us(pair.rtt)
    except ValueError as error:
        raise QuestionError(f"{where}.rtt: {error}") from error


def _check_app(where: str, app: dict[str, Any]) -> None:
    if (app.get("apiVersion"), app.get("kind")) != (API_VERSION, "RobotApp"):
        found = f"{app.get('kind')} of {app.get('apiVersion')}"[:200]
        raise QuestionError(f"{where} is {found}; only RobotApps of {API_VERSION} can be tried")
    meta = app.get("metadata")
    for field in ("name", "namespace"):
        text = meta.get(field) if isinstance(meta, dict) else None
        if not isinstance(text, str) or not is_name(text):
            raise QuestionError(f"{where}.metadata.{field}: {not_a_name(str(text)) if text else 'is missing'}")
