"""Breadth-first search through every state of a model, for what must never happen and for dead ends.

A model offers `start()`, `moves(state)`, `broken(state)` and `settled(state)`. A move is (label, progress, next state);
a label with a leading `!` is itself a violation. Progress moves are those that happen by themselves sooner or later:
from every state, using those alone, a settled state must be reachable, or the protocol is STUCK there.
"""

import time
from array import array
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

State = tuple[Any, ...]
Move = tuple[str, bool, State]


class Model(Protocol):
    def start(self) -> State: ...
    def moves(self, state: Any) -> Iterable[Move]: ...
    def broken(self, state: Any) -> str: ...
    def settled(self, state: Any) -> bool: ...


@dataclass(frozen=True)
class Result:
    """verdict: OK, or the word of the violation (DOUBLE, LOST, FLAP, DUP, STUCK). trace: labels that lead there."""

    verdict: str
    text: str
    states: int
    seconds: float
    trace: tuple[str, ...] = ()

    def __str__(self) -> str:
        path = f" after {len(self.trace)} steps: {' ; '.join(self.trace)}" if self.trace else ""
        return f"{self.verdict} {self.text} ({self.states} states, {self.seconds:.1f} s){path}"


class Exploration:
    """One search. `cap` bounds the states; reaching it is an error, because then nothing was proved."""

    def __init__(self, model: Model, *, live: bool = True, cap: int = 3_000_000) -> None:
        self.model = model
        self.live = live
        self.cap = cap
        first = model.start()
        self.states: list[State] = [first]
        self.number = {first: 0}
        self.parent = array("i", [-1])
        self.label: list[str] = [""]
        self.edge_from, self.edge_to = array("i"), array("i")
        self._shared: dict[Any, Any] = {}

    def run(self) -> Result:
        begin = time.perf_counter()
        verdict, text, at = self._search()
        if not verdict and self.live:
            verdict, text, at = self._dead_end()
        spent = time.perf_counter() - begin
        return Result(verdict or "OK", text, len(self.states), spent, self._trace(at) if verdict else ())

    def _search(self) -> tuple[str, str, int]:
        index = 0
        while index < len(self.states):
            for label, progress, following in self.model.moves(self.states[index]):
                known = self.number.get(following)
                if known is None:
                    if len(self.states) >= self.cap:
                        raise MemoryError(f"more than {self.cap} states: the scenario is too big to prove anything")
                    known = self._add(following, index, label)
                    violation = label[1:] if label[0] == "!" else self.model.broken(following)
                    if violation:
                        word, _, text = violation.partition(" ")
                        return word.rstrip(":"), text, known
                elif label[0] == "!":
                    word, _, text = label[1:].partition(" ")
                    return word.rstrip(":"), text, index
                if self.live and progress and known != index:
                    self.edge_from.append(index)
                    self.edge_to.append(known)
            index += 1
        return "", "", 0

    def _add(self, state: State, parent: int, label: str) -> int:
        # Equal parts of different states are stored once: millions of states share a few thousand parts.
        shared = self._shared
        state = tuple.__new__(type(state), [shared.setdefault(part, part) for part in state])
        number = self.number[state] = len(self.states)
        self.states.append(state)
        self.parent.append(parent)
        self.label.append(shared.setdefault(label, label))
        return number

    def _dead_end(self) -> tuple[str, str, int]:
        """Walk backwards from the settled states; whatever is not reached cannot settle."""
        count = len(self.states)
        head, chain = array("i", [-1]) * count, array("i", [0]) * len(self.edge_to)
        for edge, target in enumerate(self.edge_to):
            chain[edge] = head[target]
            head[target] = edge
        good = bytearray(count)
        todo = [number for number, state in enumerate(self.states) if self.model.settled(state)]
        for number in todo:
            good[number] = 1
        while todo:
            edge = head[todo.pop()]
            while edge >= 0:
                source = self.edge_from[edge]
                if not good[source]:
                    good[source] = 1
                    todo.append(source)
                edge = chain[edge]
        stuck = good.find(0)
        return ("STUCK", f"{count - sum(good)} states", stuck) if stuck >= 0 else ("", "", 0)

    def _trace(self, number: int) -> tuple[str, ...]:
        labels: list[str] = []
        while self.parent[number] >= 0:
            labels.append(self.label[number])
            number = self.parent[number]
        return tuple(reversed(labels))


def explore(model: Model, *, live: bool = True, cap: int = 3_000_000) -> Result:
    return Exploration(model, live=live, cap=cap).run()
