"""Plays a situation: arranges it, applies the app, and waits until what is told is what must be told, and so."""

import re
from contextlib import ExitStack

from campaigns.truth.arranging import SEEN_S, Place, Situation, app_of
from campaigns.truth.history import History
from campaigns.truth.oracle import contradictions
from campaigns.truth.screen import Screen, look
from robotapp_testbed import wait_until


def run(place: Place, situation: Situation) -> list[str]:
    """What is wrong on the screen when it has come to rest; empty when every sentence is so."""
    world = place.world
    with ExitStack() as stack:
        stack.callback(world.clear)
        history = stack.enter_context(History(world))
        try:
            stack.enter_context(situation.around(place))
            world.create(app_of(situation, place))
            if situation.then is not None:
                if situation.ready_first:
                    world.watch.until_ready("app", within_s=SEEN_S)
                stack.enter_context(situation.then(place))
        except TimeoutError as late:
            return [str(late)]
        wrong: list[str] = []

        def settled() -> bool:
            wrong[:] = _wrong(look(world, "app"), history, situation, place)
            return not wrong

        wait_until(settled, timeout_s=SEEN_S, poll_s=0.5)
        return wrong


def _wrong(screen: Screen, history: History, situation: Situation, place: Place) -> list[str]:
    if screen.status.get("observedGeneration") != screen.app["metadata"]["generation"]:
        return ["the app has not been looked at yet"]
    found = [
        f"{kind} is {'/'.join(screen.condition(kind)[:2])}, not {wanted}: {screen.condition(kind)[2]}"
        for kind, wanted in situation.says.items()
        if not _fits(screen.condition(kind)[:2], wanted)
    ]
    if screen.row["PHASE"] != situation.phase:
        found.append(f"PHASE is {screen.row['PHASE']}, not {situation.phase}")
    found += [
        f"{name} has no event, there are {screen.event_reasons}"
        for name in situation.events
        if name not in screen.event_reasons
    ]
    found += [f"{name} is an event, and is not so" for name in situation.no_events if name in screen.event_reasons]
    found += [
        f"no message has {text!r}: {screen.messages}"
        for text in situation.tells
        if not re.search(text, " | ".join(screen.messages))
    ]
    return found + list(situation.also(place, screen)) + contradictions(screen, history)


def _fits(found: tuple[str, ...], wanted: str) -> bool:
    return all(want in ("*", have) for have, want in zip(found, wanted.split("/"), strict=True))
