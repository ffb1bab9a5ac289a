"""Every situation an app can be in, live: is each condition, phase, column, event and piece of advice so?

Nodes, kubelets and telemetry are simulated; operator, scheduler and API server are real.
"""

import argparse
import re
import secrets
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack

from campaigns.rigs.simulated_site import SimulatedSite
from campaigns.truth.arranging import SEEN_S, Place, Situation, app_of, nodes, pools
from campaigns.truth.history import History
from campaigns.truth.oracle import contradictions
from campaigns.truth.screen import Screen, look
from campaigns.truth.situations import SITUATIONS
from robotapp_testbed import ControlPlane, wait_until
from robotapp_testbed.control_plane import product


def run(place: Place, situation: Situation) -> list[str]:
    """What is wrong on the screen when it has come to rest; empty when every sentence is so."""
    site = place.site
    with ExitStack() as stack:
        stack.callback(site.clear)
        history = stack.enter_context(History(site))
        try:
            stack.enter_context(situation.around(place))
            site.create(app_of(situation, place))
            if situation.then is not None:
                if situation.ready_first:
                    site.watch.until_ready("app", within_s=SEEN_S)
                stack.enter_context(situation.then(place))
        except TimeoutError as late:
            return [str(late)]
        wrong: list[str] = []

        def settled() -> bool:
            wrong[:] = _wrong(look(site, "app"), history, situation, place)
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


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench truth", description=__doc__)
    parser.add_argument("--only", default="", help="situations whose name this regular expression finds")
    arguments = parser.parse_args(argv)
    chosen = {name: each for name, each in SITUATIONS.items() if re.search(arguments.only, name)}
    if not chosen:
        parser.error(f"no situation is called so; there are: {', '.join(SITUATIONS)}")
    mark, failed = secrets.token_hex(2), 0
    with ControlPlane() as cp:
        product.install(cp)
        with SimulatedSite(cp, nodes(mark), pools=pools(mark)) as site:
            for name, situation in chosen.items():
                began_s = time.monotonic()
                wrong = run(Place(site, mark), situation)
                failed += bool(wrong)
                print(f"{'FALSE' if wrong else 'so':6}{time.monotonic() - began_s:6.1f} s  {name}", flush=True)
                for text in wrong:
                    print(f"       {text}", flush=True)
    print(f"{len(chosen) - failed} of {len(chosen)} situations are told as they are")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
