"""What a name may be, texts as names and label values, and the names of children, which every component derives by itself."""

import hashlib
import re
from functools import lru_cache
from typing import Final

MAX_NAME: Final = 63
HASH_LENGTH: Final = 8
DNS_LABEL: Final = re.compile(r"[a-z0-9]([-a-z0-9]{0,61}[a-z0-9])?")


def short_hash(text: str, length: int) -> str:
    """First `length` hex digits of the SHA-256 of `text`."""
    return hashlib.sha256(text.encode()).hexdigest()[:length]


def sanitise(text: str) -> str:
    """`text` in the characters of a DNS label that starts with a letter (Services ask for that); no length limit."""
    label = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")
    return label if label[:1].isalpha() else f"ra-{label}".rstrip("-")


def label_value(text: str) -> str:
    """`text` as a label value: `Intel(R) RealSense 435i` becomes `Intel-R-RealSense-435i`; "" when nothing is left."""
    return re.sub(r"[^A-Za-z0-9._]+", "-", text)[:MAX_NAME].strip("-._")


@lru_cache(maxsize=16_384)
def child_name(app: str, robot: str = "", component: str = "", *, longest: int = MAX_NAME) -> str:
    """Name of the child of one instance (`robot` is "" without robots) and component ("" for the instance's own children).

    A DNS label of at most `longest` characters; different arguments give different names, because the hash covers all of them.
    """
    readable = sanitise("-".join(part for part in (app, robot, component) if part))
    suffix = short_hash(f"{app}/{robot}/{component}", HASH_LENGTH)
    return f"{readable[: longest - HASH_LENGTH - 1].rstrip('-')}-{suffix}"
