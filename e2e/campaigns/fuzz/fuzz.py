"""Random objects that fit their schema, thrown at the running product: does it stay well, and do healthy apps beside them run?

Nodes and kubelets are simulated; operator, scheduler and API server are real. RobotApps, edits of them, RobotClaims, Rigelfiles (as
the bridge renders them), annotated pods and telemetry are sent. Where the machine is busy, healthy
apps may take five times as long as bare Deployments beside them; time without a processor holds no loop,
and where bare Deployments take longer than 0.85 s, answers may take as many times a second.
"""

import argparse
import json
import sys
from collections.abc import Sequence

from campaigns.common import options
from campaigns.fuzz.campaign import Campaign, Report, as_json
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product
from robotapp_testbed.machines.topology import fleet


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench fuzz", description=__doc__)
    parser.add_argument("--objects", type=options.count(1, 1_000_000), default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=options.report, help="also write the figures to this file")
    arguments = parser.parse_args(argv)
    with ControlPlane() as cp:
        product.install(cp)
        with SimulatedSite(cp, fleet(), pools={"well": "1-101"}, tidy=False) as site:
            campaign = Campaign(site, seed=arguments.seed, pool="well")
            report = campaign.run(arguments.objects, tell=lambda so_far: tell(so_far, arguments.objects))
    text = json.dumps(as_json(report), indent=2)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")
    return 1 if report.problems else 0


def tell(report: Report, wanted: int) -> None:
    """One line to standard error per lot: half an hour without a word looks like a hang."""
    ready = f"a healthy app Ready after {report.ready_s[-1]:.1f} s" if report.ready_s else "no healthy app Ready"
    print(f"{report.objects} of {wanted} objects, {ready}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
