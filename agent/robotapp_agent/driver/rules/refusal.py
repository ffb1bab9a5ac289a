"""A reason why a claim cannot be prepared. The kubelet writes the text as an event of the pod and tries again."""

from typing import NamedTuple


class Refusal(NamedTuple):
    """`text` names what is wrong, where, and the cure."""

    text: str
