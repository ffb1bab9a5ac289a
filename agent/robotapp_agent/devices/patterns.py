"""Regular expressions of the admin that cannot make the agent compute for ever.

Python's matcher goes back and tries again, so a pattern such as (a+)+ takes longer than the robot lives. Refused is what
makes that exponential: repeated groups, back-references, look-arounds, many choices in a row. What is left costs at most the
third power of the text's length, which is bounded, and the outcome is remembered.
"""

import itertools
import re
import warnings
from functools import lru_cache
from typing import Final

LONGEST_PATTERN: Final = 128
LONGEST_TEXT: Final = 256
"""Characters of a text that are compared; what follows is ignored."""
MOST_REPEATS: Final = 3
MOST_CHOICES: Final = 4
_FLAGS: Final = re.ASCII | re.DOTALL
_PART: Final = re.compile(r"\\.|\[\^?\]?(?:\\.|[^\]\\])*\]|\(\?:|\(\?|\{[0-9]*,?[0-9]*\}|.", re.DOTALL)
_REPEAT: Final = re.compile(r"[*+]|\{[0-9]*,?[0-9]*\}")
_FIXED: Final = re.compile(r"\{[0-9]+\}")


def problem_of(pattern: str) -> str:
    """Why this pattern cannot be used, "" when it can."""
    if len(pattern) > LONGEST_PATTERN:
        return f"longer than {LONGEST_PATTERN} characters"
    parts = _PART.findall(pattern)
    if any(part == "(?" or re.fullmatch(r"\\[1-9]", part) for part in parts):
        return "look-around, flags, named groups and back-references are not read here: use (?:…) and plain groups"
    if any(one == ")" and _REPEAT.fullmatch(other) for one, other in itertools.pairwise(parts)):
        return "a group cannot be repeated, because that may take for ever: repeat characters or classes such as [a-z]*"
    if sum(bool(_REPEAT.fullmatch(part) and not _FIXED.fullmatch(part)) for part in parts) > MOST_REPEATS:
        return f"more than {MOST_REPEATS} repeats (*, + or {{m,n}}), which may take very long"
    if parts.count("?") + parts.count("|") > MOST_CHOICES:
        return f"more than {MOST_CHOICES} choices (? or |), which may take very long: write several rules"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # what Python means to read in another way one day
            re.compile(pattern, _FLAGS)
    except (re.error, OverflowError, RecursionError, Warning) as error:
        return f"no regular expression: {error}"
    return ""


@lru_cache(maxsize=4096)
def matches(pattern: str, text: str) -> bool:
    """Whether the pattern, one that `problem_of` has nothing against, matches the whole text. Both change rarely: remembered."""
    return re.fullmatch(pattern, text[:LONGEST_TEXT], _FLAGS) is not None
