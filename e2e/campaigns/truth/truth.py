"""Every situation an app can be in, live: is each condition, phase, column, event and piece of advice so?

Nodes, kubelets and telemetry are simulated; operator, scheduler and API server are real.
"""

import argparse
import re
import secrets
import sys
import time
from collections.abc import Sequence

from campaigns.rigs.world import World
from campaigns.truth.arranging import Place, nodes, pools
from campaigns.truth.scene import run
from campaigns.truth.situations import SITUATIONS
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench truth", description=__doc__)
    parser.add_argument("--only", default="", help="situations whose name this regular expression finds")
    arguments = parser.parse_args(argv)
    chosen = {name: each for name, each in SITUATIONS.items() if re.search(arguments.only, name)}
    if not chosen:
        parser.error(f"no situation is called so; there are: {', '.join(SITUATIONS)}")
    mark, failed = secrets.token_hex(2), 0
    with ControlPlane() as cp:
        product.install(cp)
        with World(cp, nodes(mark), pools=pools(mark)) as world:
            for name, situation in chosen.items():
                began_s = time.monotonic()
                wrong = run(Place(world, mark), situation)
                failed += bool(wrong)
                print(f"{'FALSE' if wrong else 'so':6}{time.monotonic() - began_s:6.1f} s  {name}", flush=True)
                for text in wrong:
                    print(f"       {text}", flush=True)
    print(f"{len(chosen) - failed} of {len(chosen)} situations are told as they are")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
