"""All commands, in the order in which help lists them."""

from typing import Final

from rigel_bridge.verbs.check import CHECK
from rigel_bridge.verbs.completion import COMPLETION
from rigel_bridge.verbs.lifecycle import APPLY, DELETE, DIFF, ROLLBACK
from rigel_bridge.verbs.migrate import MIGRATE
from rigel_bridge.verbs.render import RENDER
from rigel_bridge.verbs.sequences import SEQUENCES
from rigel_bridge.verbs.status import COLLECT, STATUS
from rigel_bridge.verbs.verb import Verb

VERBS: Final[tuple[Verb, ...]] = (
    RENDER,
    CHECK,
    APPLY,
    DIFF,
    STATUS,
    ROLLBACK,
    DELETE,
    COLLECT,
    SEQUENCES,
    MIGRATE,
    COMPLETION,
)
