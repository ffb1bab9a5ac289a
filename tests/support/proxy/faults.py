"""The vocabulary of things that go wrong, and the rules that say when.

A fault is plain data; the server acts it out. Faults of requests: `drop`, `lose_reply`, `delay`, `answer`, `reset`,
`truncate`, `garble`. Faults of watches: `end_watch`, `gone_event`, `error_event`, `hide`, `garble_line`, `stall`.
"""

import random
import re
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import StrEnum

from tests.support.proxy.calls import Call


class Reply(StrEnum):
    PASS = "the server's answer"
    CLOSE = "connection closed without an answer"
    RESET = "TCP reset"
    TRUNCATE = "half of the answer, then closed"
    GARBLE = "status of the server, body that is no JSON"
    STATUS = "an error of our own"


@dataclass(frozen=True, slots=True)
class Fault:
    """`forward`: whether the request reaches the server. Watch faults strike after `after` events were passed on."""

    name: str
    forward: bool = True
    reply: Reply = Reply.PASS
    delay_s: float = 0.0
    status: int = 0
    reason: str = ""
    message: str = ""
    retry_after_s: float | None = None
    watch: str = ""
    after: int = 0
    count: int = 0
    hides: Callable[[bytes], bool] | None = None


PASS = Fault("pass")


def drop() -> Fault:
    """The request never reaches the server; the client sees its connection close."""
    return Fault("drop", forward=False, reply=Reply.CLOSE)


def lose_reply() -> Fault:
    """The server executes the request; the client sees its connection close."""
    return Fault("lose_reply", reply=Reply.CLOSE)


def delay(seconds: float) -> Fault:
    """The request waits in front of the server, then goes on as if nothing had happened."""
    return Fault("delay", delay_s=seconds)


def answer(
    status: int, reason: str = "", *, message: str = "", retry_after_s: float | None = None, applied: bool = False
) -> Fault:
    """An error answer; with `applied` the server has executed the request all the same."""
    return Fault(
        f"answer {status}",
        forward=applied,
        reply=Reply.STATUS,
        status=status,
        reason=reason,
        message=message or f"injected {status}",
        retry_after_s=retry_after_s,
    )


def reset(*, applied: bool = False) -> Fault:
    """TCP reset before (or, with `applied`, after) the server executed the request."""
    return Fault("reset", forward=applied, reply=Reply.RESET)


def truncate() -> Fault:
    """The server executes the request, half of its answer arrives."""
    return Fault("truncate", reply=Reply.TRUNCATE)


def garble() -> Fault:
    """The server executes the request, its answer arrives as something that is no JSON."""
    return Fault("garble", reply=Reply.GARBLE)


def end_watch(after: int = 0) -> Fault:
    """The watch ends normally after so many events, as at a server's time-out."""
    return Fault("end_watch", watch="end", after=after)


def gone_event(after: int = 0) -> Fault:
    """An ERROR event with code 410, then the end. For 410 as HTTP status: answer(410, "Expired") on verb "watch"."""
    return Fault("gone_event", watch="error", after=after, status=410, reason="Expired", message="too old")


def error_event(status: int = 500, reason: str = "InternalError", *, after: int = 0) -> Fault:
    """An ERROR event that is no 410, then the end."""
    return Fault("error_event", watch="error", after=after, status=status, reason=reason, message="injected")


def hide(count: int = 1, *, after: int = 0, when: Callable[[bytes], bool] | None = None) -> Fault:
    """`count` events (of those that `when` accepts) are lost, the watch goes on: what no server does but caches fear."""
    return Fault("hide", watch="hide", after=after, count=count, hides=when)


def garble_line(after: int = 0) -> Fault:
    """Half an event, then the end."""
    return Fault("garble_line", watch="garble", after=after)


def stall(after: int = 0) -> Fault:
    """Silence: the connection stays open and nothing comes any more."""
    return Fault("stall", watch="stall", after=after)


@dataclass(slots=True)
class Rule:
    """When a fault strikes. Empty conditions match everything; `skip` calls pass first, then `times` are struck."""

    fault: Fault
    component: str = ""
    verbs: frozenset[str] = frozenset()
    resource: str = ""
    path: str = ""
    when: Callable[[Call], bool] | None = None
    skip: int = 0
    times: int | None = 1
    probability: float = 1.0
    struck: int = 0
    seen: int = 0

    def matches(self, call: Call) -> bool:
        return (
            (not self.component or self.component == call.component)
            and (not self.verbs or call.verb in self.verbs)
            and (not self.resource or self.resource == call.resource)
            and (not self.path or re.search(self.path, call.path) is not None)
            and (self.when is None or self.when(call))
        )


@dataclass(slots=True)
class Rules:
    """All rules in force; the first that strikes wins. Chance is drawn from one seeded source in order of arrival."""

    seed: int = 0
    _rules: list[Rule] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _random: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)

    def add(self, rule: Rule) -> Rule:
        with self._lock:
            self._rules.append(rule)
        return rule

    def remove(self, rule: Rule) -> None:
        with self._lock:
            self._rules = [kept for kept in self._rules if kept is not rule]

    def clear(self) -> None:
        with self._lock:
            self._rules = []

    def pick(self, call: Call) -> Fault:
        with self._lock:
            for rule in self._rules:
                if rule.fault.watch and call.verb != "watch":
                    continue
                if not rule.matches(call) or (rule.times is not None and rule.struck >= rule.times):
                    continue
                rule.seen += 1
                if rule.seen <= rule.skip:
                    continue
                if rule.probability < 1.0 and self._random.random() >= rule.probability:
                    continue
                rule.struck += 1
                return rule.fault
        return PASS


def verbs_of(verbs: str | Iterable[str]) -> frozenset[str]:
    """One verb, several, or the word "write" for all that change something."""
    listed = [verbs] if isinstance(verbs, str) else list(verbs)
    expanded = {"create", "update", "patch", "delete", "deletecollection"} if "write" in listed else set()
    return frozenset((set(listed) | expanded) - {"write", ""})
