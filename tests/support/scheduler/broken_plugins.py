# ruff: noqa: ARG002 - every class is one mistake somebody will make
"""Plugins of somebody else's that break: in their constructor, in a hook, or by what they answer. Named as module:Class."""

import sys
from typing import Any

import numpy as np

from robotapp_scheduler.core.framework.interface import PerDomain, PreFilter, Scores, Status, Verdict


class Nameless:
    def filter(self, pod: Any, nodes: Any) -> Any:
        return np.ones(nodes.n, dtype=np.bool_)


class _Filters:
    def filter(self, pod: Any, nodes: Any) -> Any:
        return np.ones(nodes.n, dtype=np.bool_)


class NameIsANumber(_Filters):
    name = 7


class WantsAnArgument(_Filters):
    name = "WantsAnArgument"

    def __init__(self, database: str) -> None:
        self.database = database


class CannotStart(_Filters):
    name = "CannotStart"

    def __init__(self) -> None:
        raise RuntimeError("no route to the laboratory")


class Exits(_Filters):
    name = "Exits"

    def __init__(self) -> None:
        sys.exit(3)


class StrangeArguments(_Filters):
    name = "StrangeArguments"
    Args = 5


class ReadsLetters(_Filters):
    name = "ReadsLetters"
    reads = "labels"


class ReadsTheUnknown(_Filters):
    name = "ReadsTheUnknown"
    reads = ("mood",)
    node_reads = ("weather",)


class NormalizesSomehow(_Filters):
    name = "NormalizesSomehow"
    normalize = "mean"


class EventsByName(_Filters):
    name = "EventsByName"
    events = ("nodes",)


class HookIsAText(_Filters):
    name = "HookIsAText"
    score = "often"


class CalledLikeFit(_Filters):
    name = "NodeResourcesFit"


class SpeltAsInGo(_Filters):
    name = "SpeltAsInGo"

    def preFilter(self, pod: Any, nodes: Any) -> None: ...  # noqa: N802 - the mistake


class ScoresBefore(_Filters):
    name = "ScoresBefore"

    def pre_score(self, pod: Any, nodes: Any) -> None: ...


class CannotBeLookedAt(_Filters):
    name = "CannotBeLookedAt"

    @property
    def score(self) -> Any:
        raise RuntimeError("not calibrated")


UNUSABLE = {
    Nameless: "`name` must be a text, got None",
    NameIsANumber: "`name` must be a text, got 7",
    WantsAnArgument: "missing 1 required positional argument",
    CannotStart: "RuntimeError: no route to the laboratory",
    Exits: "SystemExit: 3",
    StrangeArguments: "cannot be made",
    ReadsLetters: "`reads` must be a tuple",
    ReadsTheUnknown: "`reads` names mood",
    NormalizesSomehow: "`normalize` is 'mean'",
    EventsByName: "`events` must be a Change",
    HookIsAText: "`score` must be a function",
    SpeltAsInGo: "plugin SpeltAsInGo: `preFilter` is no hook; did you mean `pre_filter`?",
    ScoresBefore: "`pre_score` is no hook here: what is the same for all nodes is worked out in `score`",
    CannotBeLookedAt: "CannotBeLookedAt' cannot be looked at: RuntimeError: not calibrated",
    CalledLikeFit: "are both called 'NodeResourcesFit'",
}
"""Refused when the configuration is read, with these words."""


def breaking(hook: str, answer: Any) -> type:
    """A plugin whose hook raises this exception, or answers this (a function is asked with the hook's arguments)."""

    def asked(_self: Any, *args: Any) -> Any:
        if isinstance(answer, BaseException):
            raise answer
        return answer(*args) if callable(answer) else answer

    name = f"Breaks{hook.title().replace('_', '')}"
    reads: dict[str, Any] = {"reads": (), "node_reads": ("requested",), "row_local": hook.endswith("_row")}
    beside = {"filter_row": "filter", "score_row": "score", "minds": "filter", "confined": "filter"}
    ones: dict[str, Any] = {
        "filter": lambda _self, _pod, nodes: np.ones(nodes.n, dtype=np.bool_),
        "score": lambda _self, _pod, nodes: np.ones(nodes.n),
    }
    other = {beside[hook]: ones[beside[hook]]} if hook in beside else {}
    if hook == "relevant":
        other = {"score_among": lambda _self, _pod, _nodes, feasible: np.zeros(len(feasible))}
    return type(name, (), {"name": name, **reads, **other, hook: asked})


def _refusing(**more: Any) -> Any:
    return lambda _pod, nodes: Verdict(np.zeros(nodes.n, dtype=np.bool_), **more)


ANSWERS: list[tuple[str, Any, str]] = [
    *((hook, ZeroDivisionError("ouch"), f"{hook} raised ZeroDivisionError: ouch")
      for hook in ("filter", "score", "score_among", "relevant", "pre_filter", "filter_row", "score_row")),
    ("filter", SystemExit(3), "filter raised SystemExit: 3"),
    ("filter", MemoryError(), "filter raised MemoryError"),
    ("pre_filter", ["n0"], "pre_filter must answer a PreFilter or None, got list"),
    ("filter", lambda _pod, nodes: Verdict(np.zeros(nodes.n, dtype=np.bool_), codes=np.full(nodes.n, 7), reasons=(("a",),)),
     "unusable codes"),
    ("filter", _refusing(reasons="abc"), "unusable reasons"),
    ("filter", _refusing(reasons=((5,),)), "unusable reasons"),
    ("filter", _refusing(reasons=(("r",),), detail=np.ones(1)), "unusable detail"),
    ("filter", _refusing(reasons=(("r",),), resolvable=np.ones(1, dtype=np.bool_)), "unusable resolvable"),
    ("score", lambda _pod, nodes: PerDomain(np.ones(9), nodes.label("zone")), "score must answer a number array of shape"),
    ("score", PerDomain(np.ones(1), 5), "score must answer a PerDomain with a label of `nodes.label(…)`, got 5"),  # type: ignore[arg-type]  # the mistake
    ("score", [1, 2, 3], "score must answer a number array of shape (3,), got list"),
    ("score", lambda _pod, nodes: Scores(np.ones(nodes.n), "mean"), "normalize 'mean'"),
    ("score", lambda _pod, nodes: Scores(np.ones(nodes.n), ["max"]), "normalize ['max']; it may be one of inverse, max, minmax, none"),  # type: ignore[arg-type]  # the mistake
    ("filter", _refusing(label="zone"), "unusable label"),
    ("filter", lambda _pod, nodes: Verdict(np.zeros(9, dtype=np.bool_), label=nodes.label("zone")), "unusable label"),
    ("filter", lambda _pod, nodes: Verdict(np.zeros(nodes.n, dtype=np.bool_), detail=np.array(["a"] * nodes.n)), "unusable detail"),
    ("pre_filter", PreFilter("n0"), "names are a set of texts, got 'n0'"),  # type: ignore[arg-type]  # the mistake
    ("pre_filter", PreFilter(7), "names are a set of texts, got 7"),  # type: ignore[arg-type]  # the mistake
    ("pre_filter", PreFilter(status=Status("Never", "no")), "got one with code 'Never', which is no Code"),  # type: ignore[arg-type]  # the mistake
    ("pre_filter", PreFilter(status=5), "whose status is a Status or None, got int"),  # type: ignore[arg-type]  # the mistake
    ("score_among", lambda _pod, nodes, _feasible: np.zeros(nodes.n + 1), "score_among must answer a number array of shape (3,), got float64 (4,)"),
    ("score_among", 1000, "score_among must answer 0 to 100, got 1000"),
    ("minds", ["weather"], "minds must answer names of facts of nodes, got ['weather']"),
    ("score_row", "x", "score_row must answer an integer, got 'x'"),
    ("score_row", 10**9, "score_row must answer 0 to 100, got 1000000000"),
    ("post_filter", "never mind", "post_filter must answer an Outcome, got str"),
]  # fmt: skip
"""(hook, what it raises or answers, what the pod is told)."""
