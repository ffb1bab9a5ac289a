"""All commands, in the order in which help lists them."""

from typing import Final

from rigel_bridge.verbs.render import RENDER
from rigel_bridge.verbs.verb import Verb

VERBS: Final[tuple[Verb, ...]] = (RENDER,)
