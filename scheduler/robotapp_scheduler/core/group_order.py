"""In which order the pods of a group are placed one by one: nobody is left between two neighbours that are far apart."""

import heapq
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from robotapp_scheduler.core.pods.pod_info import Member, PodInfo
from robotapp_scheduler.core.robotics.app_index import AppIndex

PINNED: Final = 1
"""A pod with so few places is an anchor of the others, whoever its neighbours are."""


def group_order(pods: Sequence[PodInfo], room: Mapping[str, int], apps: AppIndex) -> list[PodInfo]:
    """Who has one place at most, then along the edges of the app from pod to pod; among equals the fewest places first.

    `room` is the number of places by pod uid.
    """
    of: dict[Member, list[int]] = {}
    for i, pod in enumerate(pods):
        if pod.member is not None:
            of.setdefault(pod.member, []).append(i)
    heap = [_entry(pods[i], i, room, reached=False) for i in range(len(pods))]
    heapq.heapify(heap)
    order: list[PodInfo] = []
    done: set[int] = set()
    walked: set[Member] = set()
    while heap:
        *_, i = heapq.heappop(heap)
        if i in done:
            continue
        done.add(i)
        order.append(pods[i])
        member = pods[i].member
        if member is not None and member not in walked:
            walked.add(member)
            for near in _neighbours(member, apps):
                for k in of.get(near, ()):
                    heapq.heappush(heap, _entry(pods[k], k, room, reached=True))
    return order


def _entry(pod: PodInfo, i: int, room: Mapping[str, int], *, reached: bool) -> tuple[int, int, str, str, int]:
    places = room[pod.uid]
    rank = 0 if places <= PINNED else 1 if reached else 2
    return (rank, places, pod.namespace, pod.name, i)


def _neighbours(member: Member, apps: AppIndex) -> Iterator[Member]:
    """Components at the other ends of its edges, of the same instance."""
    app = apps.app(member.app_uid)
    links = app.links.get(member.component, ()) if app is not None else ()
    return (member._replace(component=link.peer) for link in links)
