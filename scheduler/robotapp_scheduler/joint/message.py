"""Problems and solutions as bytes, between the scheduler and its planning worker. Both ends are of one version."""

from typing import Any

import msgspec
import numpy as np

from robotapp_scheduler.joint.latencies import Latencies, Measured
from robotapp_scheduler.joint.link_limits import LinkLimits
from robotapp_scheduler.joint.problem import Edge, Problem, Relation
from robotapp_scheduler.joint.solve import Limits, Solution


class _Array(msgspec.Struct, array_like=True):
    kind: str
    shape: tuple[int, ...]
    content: bytes


class _Order(msgspec.Struct, array_like=True):
    arrays: list[_Array]
    edges: list[tuple[Any, ...]]
    limits: tuple[float, int, float, int]
    step: float
    flows: tuple[tuple[tuple[int, int, int], ...], tuple[tuple[int, int, int], ...]] | None
    """Of the links: between pods, and to placed ends. What is left on the rows is the last array."""


def encode_problem(problem: Problem, limits: Limits) -> bytes:
    """An order for the worker."""
    rtt = problem.rtt
    arrays = (
        problem.cost,
        problem.demand,
        problem.free,
        rtt.zone,
        rtt.path_us,
        rtt.access_us,
        rtt.minimum_us,
        *rtt.measured,
        *(() if problem.crowd is None else (problem.crowd,)),
        *(() if problem.links is None else (problem.links.free_bps,)),
    )
    order = _Order(
        arrays=[_Array(array.dtype.str, array.shape, np.ascontiguousarray(array).tobytes()) for array in arrays],
        edges=[tuple(edge) for edge in problem.edges],
        limits=(limits.seconds, limits.steps, limits.gap, limits.cells),
        step=problem.step,
        flows=(problem.links.pairs, problem.links.ends) if problem.links is not None else None,
    )
    return msgspec.msgpack.encode(order)


def decode_problem(content: bytes) -> tuple[Problem, Limits]:
    """What `encode_problem` made."""
    order = msgspec.msgpack.decode(content, type=_Order)
    cost, demand, free, zone, path_us, access_us, minimum_us, left, right, us, *more = (
        np.frombuffer(array.content, dtype=array.kind).reshape(array.shape) for array in order.arrays
    )
    edges = tuple(Edge(edge[0], edge[1], Relation(edge[2]), *edge[3:]) for edge in order.edges)
    rtt = Latencies(zone, path_us, Measured(left, right, us), access_us=access_us, minimum_us=minimum_us)
    links = LinkLimits(more.pop(), *order.flows) if order.flows is not None else None
    problem = Problem(cost, demand, free, edges, rtt, order.step, more[0] if more else None, links)
    return problem, Limits(*order.limits)


def encode_solution(solution: Solution) -> bytes:
    """The worker's answer."""
    return msgspec.msgpack.encode(solution)


def decode_solution(content: bytes) -> Solution:
    """What `encode_solution` made."""
    return msgspec.msgpack.decode(content, type=Solution)
