"""Answers of POST /what-if, in a forked worker: the question is decided there, on a cache that nobody uses afterwards."""

import time
from typing import Final

import msgspec

from robotapp_scheduler.config import load as configuration
from robotapp_scheduler.config.load import ConfigError, SchedulerConfig
from robotapp_scheduler.core.cycle.schedule_one import SchedulerCore
from robotapp_scheduler.plugins.registry import catalogue
from robotapp_scheduler.port.frames import Request
from robotapp_scheduler.shell.config.reload import Running
from robotapp_scheduler.shell.planner.container_memory import FORK_BYTES
from robotapp_scheduler.what_if import decide
from robotapp_scheduler.what_if.difference import visible
from robotapp_scheduler.what_if.question import Question, QuestionError, UnknownNodeError, parse

WRONG: Final = 400
NO_SUCH_NODE: Final = 422
"""Not 404, by which clients know an older scheduler."""
MOST_ANSWER: Final = 8 << 20
"""Bytes. The answer passes through the process that places pods."""
TOO_LARGE: Final = f"to decide this takes more than {FORK_BYTES >> 20} MiB; ask about fewer or smaller apps"
TOO_LONG: Final = f"the answer has more than {MOST_ANSWER >> 20} MiB; ask about fewer nodes, or fewer or smaller apps"


class WhatIf:
    """Call it with the request in a forked worker: it changes the cache for good."""

    def __init__(self, core: SchedulerCore, running: Running) -> None:
        self._core = core
        self._running = running

    def __repr__(self) -> str:
        return f"<WhatIf of {self._core!r}>"

    def __call__(self, request: Request) -> tuple[int, bytes]:
        """HTTP status and body."""
        try:
            question = parse(request.body)
            found = decide.answer(self._core, question, self._config(question), clock=time.monotonic)
            nodes = self._core.cluster.nodes.row_of
            shown = visible(found, namespace=request.namespace, with_nodes=request.with_nodes, nodes=nodes)
            answer = msgspec.json.encode(shown)
        except UnknownNodeError as error:
            return NO_SUCH_NODE, msgspec.json.encode({"error": str(error)})
        except QuestionError as error:
            return WRONG, msgspec.json.encode({"error": str(error)})
        except ConfigError as error:
            problems = {"error": "the configuration cannot be used", "problems": list(error.problems)}
            return WRONG, msgspec.json.encode(problems)
        except MemoryError:  # nothing of the question is held any more
            return WRONG, msgspec.json.encode({"error": TOO_LARGE})
        return (200, answer) if len(answer) <= MOST_ANSWER else (WRONG, msgspec.json.encode({"error": TOO_LONG}))

    def _config(self, question: Question) -> SchedulerConfig | None:
        """Its configuration may name only plugins that the running one has loaded."""
        if question.config is None:
            return None
        third_party = self._running.config.third_party
        return configuration.parse(question.config, catalogue=catalogue(), third_party=third_party)
