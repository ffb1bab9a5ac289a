"""Operators of the domain model: rule 5."""

from collections.abc import Iterator
from typing import Any

from campaigns.claims.model.domain_basis import DELETED, IDLE, LIVE, ORPHANED, Basis, State, move, put
from campaigns.claims.model.domain_rules import NONE
from campaigns.claims.model.explore import Move
from robotapp_claims.rules.domain import Step
from robotapp_claims.rules.identity import Found


class Operators(Basis):
    def _operator(self, s: State, k: int, op: tuple[Any, ...]) -> Iterator[Move]:
        if op == IDLE:
            for h in range(len(self.names)):
                if self._state(s, h) != LIVE:
                    continue
                if s.wants[h] == NONE:
                    if self._deployment(s, h):
                        yield move(s, f"O deletes Deployment h{h}", True, **self._set_deployment(s, h, None))
                else:
                    yield move(s, f"O reads h{h}", True, operators=self._ops(s, k, ("read", h, s.wants[h])))
            return
        yield move(s, "O dies", False, operators=self._ops(s, k))
        step, h, x = op
        if step == "read":
            held, named = self._own(s, h), self._named(s, h)
            for plan in self.rules.plans(self.who[h], held, named, x, self.all_ids):
                to = self._after_list(s, h, plan)
                yield move(s, f"O lists h{h}: {plan.step} {to[1:]}", True, operators=self._ops(s, k, to))
        elif step == "adopt":
            operators = self._ops(s, k, ("write", h, x), claim=x)
            changed = self._claim_changed(s, x, (h, 0)) | {"operators": operators, "sweepers": self._sweeps(s, claim=x)}
            yield move(s, f"O touches id{x}", True, **changed)
        elif step == "create":
            yield from self._create(s, k, h, x)
        elif step == "stop":
            yield move(s, f"O scales h{h} to 0", True, **self._set_deployment(s, h, (h, x, 0), k))
        else:
            yield self._write_template(s, k, h, x)

    def _after_list(self, s: State, h: int, plan: Any) -> tuple[Any, ...]:
        if plan.step is Step.CREATE:
            return ("create", h, plan.candidates) if plan.candidates else self._no_id(s, h)
        if plan.step is Step.ADOPT:
            return ("adopt", h, plan.id)
        return IDLE if self._deployment(s, h) == (h, plan.id, 1) else ("write", h, plan.id)

    def _no_id(self, s: State, h: int) -> tuple[Any, ...]:
        found = self._deployment(s, h)
        held = tuple(x for x, _ in self._own(s, h))
        if found and found[2] and found[1] != NONE and self.rules.scales_down(self.who[h], found[1], held):
            return ("stop", h, found[1])
        return IDLE

    def _create(self, s: State, k: int, h: int, candidates: tuple[int, ...]) -> Iterator[Move]:
        x, claim = candidates[0], s.claims[candidates[0]]
        if self.old_cache and (claim is None or claim[0] != h):
            to = ("create", h, candidates[1:]) if candidates[1:] else self._no_id(s, h)
            yield move(s, f"O passes over id{x}", False, operators=self._ops(s, k, to))
        if claim is None:
            changed = {"claims": put(s.claims, x, (h, 0)), "sweepers": self._sweeps(s, claim=x, gone=True)}
            to = ("write", h, x)
            yield move(s, f"O creates id{x} h{h}", True, operators=self._ops(s, k, to, claim=x), **changed)
            yield move(s, f"O creates id{x} h{h}, no answer", False, operators=self._ops(s, k, claim=x), **changed)
        elif self.rules.met(self.who[h], x, self.who[claim[0]]) is Found.MINE:
            yield move(s, f"O meets its own id{x}: starts over", True, operators=self._ops(s, k))
        elif candidates[1:]:
            yield move(s, f"O meets id{x}", True, operators=self._ops(s, k, ("create", h, candidates[1:])))
        else:
            yield move(s, f"O h{h} has no id", True, operators=self._ops(s, k, self._no_id(s, h)))

    def _write_template(self, s: State, k: int, h: int, x: int) -> Move:
        found = self._deployment(s, h)
        moved = found and found[1] not in {x, NONE} and s.claims[found[1]] == (h, 0)
        flap = "!FLAP " if moved and self._state(s, h) == LIVE and not self.specs and self.only != "DOUBLE" else ""
        changed = self._set_deployment(s, h, (h, x, 1), k)
        if self._state(s, h) == ORPHANED:
            # The write gives the orphan its dead owner back: the garbage collector will take it.
            changed["apps"] = put(s.apps, self.apps[h], DELETED)
        return move(s, f"{flap}O writes template h{h} id{x}", True, **changed)
