"""Whether any placement meets all budgets, proved by HiGHS (scipy.optimize.milp), independently of our planner."""

from enum import StrEnum
from typing import Final

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import lil_array

from campaigns.divergence.topology import Topology

SECONDS: Final = 60.0
_OPTIMAL, _INFEASIBLE = 0, 2


class Proof(StrEnum):
    """What is proved of a set of budgets."""

    FEASIBLE = "feasible"
    INFEASIBLE = "infeasible"
    OPEN = "open"
    """Neither within the time."""


def proof(topology: Topology, *, seconds: float = SECONDS) -> Proof:
    """One variable per component and node. A feasible answer is checked against the topology itself."""
    nodes = [machine.name for machine in topology.machines]
    count = len(nodes)
    index = {part.name: i for i, part in enumerate(topology.parts)}
    upper = np.ones(len(topology.parts) * count)
    for part in topology.parts:
        if part.node:
            own = slice(index[part.name] * count, (index[part.name] + 1) * count)
            upper[own] = [float(name == part.node) for name in nodes]
    rows: list[tuple[dict[int, float], float, float]] = [
        ({i * count + n: 1.0 for n in range(count)}, 1.0, 1.0) for i in range(len(topology.parts))
    ]
    for n, machine in enumerate(topology.machines):
        load = {index[part.name] * count + n: float(part.cpu_milli) for part in topology.parts}
        rows.append((load, -np.inf, float(machine.free_milli)))
    for wire in topology.wires:
        start, end = index[wire.start] * count, index[wire.end] * count
        for n, name in enumerate(nodes):
            far = [m for m, other in enumerate(nodes) if topology.p95_us(name, other) > wire.budget_us]
            if far:  # with this end here, the other one is on none of these
                rows.append(({start + n: 1.0, **{end + m: 1.0 for m in far}}, -np.inf, 1.0))
    matrix = lil_array((len(rows), len(upper)))
    for r, (entries, _, _) in enumerate(rows):
        for column, value in entries.items():
            matrix[r, column] = value
    found = milp(
        np.zeros(len(upper)),
        integrality=np.ones(len(upper)),
        bounds=Bounds(0.0, upper),
        constraints=LinearConstraint(matrix.tocsr(), [low for _, low, _ in rows], [high for _, _, high in rows]),
        options={"time_limit": seconds},
    )
    if found.status == _INFEASIBLE:
        return Proof.INFEASIBLE
    if found.status != _OPTIMAL:
        return Proof.OPEN
    where = {
        part.name: nodes[int(found.x[i * count : (i + 1) * count].argmax())]
        for part, i in zip(topology.parts, index.values(), strict=True)
    }
    assert topology.fits(where), "HiGHS overloads a node"
    assert topology.met(where) == len(topology.wires), "HiGHS breaks a budget"
    return Proof.FEASIBLE
