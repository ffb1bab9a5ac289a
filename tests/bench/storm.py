"""A storm of claims: far more wishes than domains and devices, deaths and forgeries, judged at every revision of the store.

Nodes and kubelets are simulated; two operators, two schedulers and the API server are real.
"""

import argparse
import json
import sys
from collections.abc import Sequence

from tests.bench import options
from tests.support.storm.campaign import Storm

from robotapp_testbed import ControlPlane, product


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench storm", description=__doc__)
    parser.add_argument("--grants", type=options.count(1, 10_000_000), default=20_000)
    parser.add_argument("--wanted", type=options.count(1, 5000), default=500, help="apps and pods at a time")
    parser.add_argument("--robots", type=options.count(1, 100), default=10, help="robots with five devices each")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args(argv)
    with ControlPlane(node_lease_s=400) as cp:
        product.install(cp, values={"domainPool": {"quarantineSeconds": 1}})
        storm = Storm(cp, wanted=arguments.wanted, robots=arguments.robots, seed=arguments.seed)
        report = storm.run(arguments.grants)
    figures = {
        "grants": report.verdict.grants,
        "revisions": report.verdict.revisions,
        "seconds": round(report.seconds, 1),
        "kills": report.kills,
        "forged": report.forged,
        "double": len(report.verdict.broken),
        "lost": len(report.lost),
        "left": len(report.left),
        "problems": report.problems,
    }
    print(json.dumps(figures, indent=2))
    return 1 if report.problems else 0


if __name__ == "__main__":
    sys.exit(main())
