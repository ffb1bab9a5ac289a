"""A program of ours that loses answers: writes that the API server has done end, for the program, in a broken connection.

`python -m campaigns.storm.program robotapp_operator --lose 0.02 --seed 7 -- <arguments of the operator>`. The loss is
made in the program itself, behind its connections: a proxy would need as much CPU as the API server. `--weakened` replaces a
rule of the claims by one that a campaign must notice.
"""

import argparse
import importlib
import logging
import random
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any, Final

from campaigns.claims.claims_weakened import ALL
from robotapp_client.transport.errors import Unreachable
from robotapp_client.transport.http_transport import SAFE_METHODS, Done, HttpTransport, Response

log = logging.getLogger(__name__)
LOST: Final = "the answer was lost on purpose"
ROUTINE: Final = ("/events", "/leases/")
"""Not of interest: an event is done again, and who loses his Lease ends by himself."""


class Loser:
    """Replaces the two ways of writing. `share` of the answers to writes of any status never arrive."""

    def __init__(self, share: float, seed: int) -> None:
        self._share = share
        self._chance = random.Random(seed)

    def loses(self, method: str, path: str) -> Unreachable | None:
        """The error instead of the answer to this request, None when it arrives."""
        if method in SAFE_METHODS or any(part in path for part in ROUTINE) or self._chance.random() >= self._share:
            return None
        log.warning("%s %s: %s", method, path, LOST)
        return Unreachable(f"{method} {path}: {LOST}", maybe_applied=True)

    def install(self) -> None:
        request, post = HttpTransport.request, HttpTransport.post

        async def lossy_request(transport: HttpTransport, method: str, path: str, **settings: Any) -> Response:
            answer = await request(transport, method, path, **settings)
            error = self.loses(method, path)
            if error is not None:
                raise error
            return answer

        def lossy_post(transport: HttpTransport, path: str, body: bytes, done: Done, **settings: Any) -> None:
            def hear(outcome: Any) -> None:
                done(self.loses("POST", path) or outcome)

            post(transport, path, body, hear, **settings)

        HttpTransport.request = lossy_request  # type: ignore[method-assign]
        HttpTransport.post = lossy_post  # type: ignore[method-assign]


def command(*, lose: float = 0.0, seed: int = 0, weakened: str = "") -> tuple[str, ...]:
    """What runs a module in place of `-m`: `(*command(…), "robotapp_operator", *arguments)`."""
    given = ["campaigns.storm.program", f"--lose={lose}", f"--seed={seed}"]
    return (*given, *((f"--weakened={weakened}",) if weakened else ()))


def run_program(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lose", type=float, default=0.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--weakened", choices=sorted(ALL), default=None)
    parser.add_argument("module")
    parser.add_argument("arguments", nargs=argparse.REMAINDER)
    options = parser.parse_args(argv)
    sys.argv = [options.module, *options.arguments]
    if options.lose:
        Loser(options.lose, options.seed).install()
    with ExitStack() as stack:
        if options.weakened:
            stack.enter_context(ALL[options.weakened]())
        return int(importlib.import_module(f"{options.module}.main").main() or 0)


if __name__ == "__main__":
    sys.exit(run_program(sys.argv[1:]))
