"""Thousands of made Rigelfiles: read by Rigel 0.2.22 and by us, and broken ones that must end in lines and a code."""

import argparse
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.support.rigel.cases import ENVIRONMENT, first_generation, mutated

from campaigns.bridge.bridge_watch import run
from campaigns.bridge.rigel_differences import difference, readings

REQUIREMENTS = ("rigel==0.2.22", "setuptools<82")  # setuptools 82 dropped pkg_resources, which Rigel imports


def main() -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench rigelfiles", description=__doc__)
    parser.add_argument("--compared", type=int, default=500, help="files that both read (default 500)")
    parser.add_argument("--broken", type=int, default=2000, help="broken files (default 2000)")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    arguments = parser.parse_args()
    print(f"seed {arguments.seed}")
    with tempfile.TemporaryDirectory() as folder:
        failed = compared(Path(folder), arguments.compared, arguments.seed) if arguments.compared else 0
        failed += broken(Path(folder) / "Rigelfile", arguments.broken, arguments.seed) if arguments.broken else 0
    return 1 if failed else 0


def compared(folder: Path, count: int, seed: int) -> int:
    """How many files both programs read differently without a reason."""
    python = environment(folder / "venv")
    (folder / "files").mkdir()
    texts = [first_generation(seed + number) for number in range(count)]
    theirs = readings(python, folder / "files", texts, ENVIRONMENT)
    failed = 0
    for number, (text, one) in enumerate(zip(texts, theirs, strict=True)):
        if found := difference(text, one, ENVIRONMENT):
            failed += 1
            print(f"seed {seed + number}: {found}")
    taken = sum("packages" in one for one in theirs)
    print(f"compared {count}: Rigel takes {taken}; {failed} unexplained")
    return failed


def broken(path: Path, count: int, seed: int) -> int:
    """How many broken files end otherwise than in lines and a code."""
    failed, codes, slowest_s = 0, Counter[int](), 0.0
    for number in range(seed, seed + count):
        path.write_bytes(mutated(number))
        for arguments in (["render"], ["check"]):
            try:
                found = run(path, *arguments)
            except Exception as error:  # noqa: BLE001  # that is what is looked for
                failed += 1
                print(f"seed {number}: {arguments} ended with {type(error).__name__}: {error}")
                continue
            codes[found.code] += 1
            slowest_s = max(slowest_s, found.cpu_s)
            if found.cpu_s > 1 or found.written > 1_000_000 or found.foreign:
                failed += 1
                print(
                    f"seed {number}: {arguments} {found.cpu_s:.1f} s, {found.written} characters, touched {found.foreign}"
                )
    print(
        f"broken {count}: exit codes {dict(sorted(codes.items()))}, slowest {slowest_s:.2f} s of CPU; {failed} failed"
    )
    return failed


def environment(folder: Path) -> Path:
    """The interpreter of an environment with the real Rigel."""
    uv = str(Path(sys.executable).parent / "uv")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    subprocess.run([uv, "venv", "--quiet", "--python", version, str(folder)], check=True)
    python = folder / "bin" / "python"
    subprocess.run([uv, "pip", "install", "--quiet", "--python", str(python), *REQUIREMENTS], check=True)
    return python


if __name__ == "__main__":
    sys.exit(main())
