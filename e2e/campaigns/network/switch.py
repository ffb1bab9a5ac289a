"""The latency switch: how exact its delay and loss are, and how much it carries, between plain network namespaces.

Needs root. A quiet machine: sender, switch and receiver share its cores. Half a minute; `--long` a few.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict

from campaigns.common import options
from campaigns.common.output import save
from campaigns.network.namespaced import Wire, missing
from campaigns.network.switch_figures import Capacity, Delay, Loss, delay, load, loss

DELAYS_MS = (0.0, 2.0, 15.0, 60.0)
LOSSES = (0.01, 0.05, 0.2)
LOADS = (("20 kpps", 20_000, 64), ("40 kpps", 40_000, 64), ("100 Mbit/s", 8_600, 1_412), ("200 Mbit/s", 17_200, 1_412))
MOST_ERROR_MS = 0.3
MOST_LOSS_ERROR = 0.2
REQUIRED_LOADS = ("20 kpps", "100 Mbit/s")


def main(argv: Sequence[str] | None = None) -> int:
    arguments = _parser().parse_args(argv)
    reason = missing()
    if reason:
        print(reason, file=sys.stderr)
        return 1
    scale = 5 if arguments.long else 1
    with Wire(["a", "b"], seed=arguments.seed) as wire:
        wire.settle()
        delays = [delay(wire, each_ms, count=(200 if each_ms < 60 else 60) * scale) for each_ms in DELAYS_MS]
        losses = [loss(wire, share, count=20_000 * scale) for share in LOSSES]
        loads = {
            name: load(wire, per_second=per_second, payload_bytes=size, seconds=3 * scale)
            for name, per_second, size in LOADS
        }
    report(delays, losses, loads)
    figures = {
        "delays": [asdict(each) for each in delays],
        "losses": [asdict(each) for each in losses],
        "loads": {name: asdict(each) for name, each in loads.items()},
    }
    save(arguments.json, figures)
    problems = verdict(delays, losses, loads)
    print("\n".join(problems) or "all bounds are kept")
    return 1 if problems else 0


def verdict(delays: Sequence[Delay], losses: Sequence[Loss], loads: dict[str, Capacity]) -> list[str]:
    """What falls short, in sentences."""
    problems = [
        f"{each.set_ms:g} ms: the median is {each.error_ms:.3f} ms off, more than {MOST_ERROR_MS}"
        for each in delays
        if abs(each.error_ms) > MOST_ERROR_MS
    ]
    problems += [
        f"loss {each.set_share:.0%}: {each.seen_share:.2%} seen, more than {MOST_LOSS_ERROR:.0%} off"
        for each in losses
        if each.error > MOST_LOSS_ERROR
    ]
    return problems + [f"{name}: {loads[name].lost} frames lost" for name in REQUIRED_LOADS if loads[name].lost]


def report(delays: Sequence[Delay], losses: Sequence[Loss], loads: dict[str, Capacity]) -> None:
    print(f"{'one-way delay':>16}{'median error ms':>18}{'p99 error ms':>15}")
    for step in delays:
        print(f"{step.set_ms:>13g} ms{step.error_ms:>18.3f}{step.p99_error_ms:>15.3f}")
    print(f"\n{'loss set':>16}{'seen':>18}")
    for share in losses:
        print(f"{share.set_share:>16.1%}{share.seen_share:>18.2%}")
    print(f"\n{'load':>16}{'frames/s':>12}{'Mbit/s':>10}{'lost':>8}{'switch CPU':>13}")
    for name, each in loads.items():
        print(f"{name:>16}{each.frames_s:>12,.0f}{each.mbit_s:>10.0f}{each.lost:>8}{each.cpu_share:>13.0%}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench switch", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--long", action="store_true", help="five times as many packets")
    parser.add_argument("--seed", type=int, default=1, help="of the losses")
    parser.add_argument("--json", type=options.report, help="write the figures to this file")
    return parser


if __name__ == "__main__":
    sys.exit(main())
