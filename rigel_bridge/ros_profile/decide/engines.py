"""How units are classified: `rules` (ours) or `thesis` (the heuristic it began with, for comparison)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ros_profile.model.conclusions import Assessment
from ros_profile.model.package import Unit


@dataclass(frozen=True, slots=True)
class Engine:
    """`classify` judges one executable or package, also one of which only the name is known; `aggregate` joins the
    judgements of what runs together.
    """

    name: str
    classify: Callable[[Unit], Assessment]
    aggregate: Callable[[Sequence[Assessment]], Assessment]


def abstaining(*, curated: bool) -> Engine:
    """Concludes nothing: for reading and edges alone."""
    del curated
    return Engine("none", lambda _: Assessment(None), lambda _: Assessment(None))
