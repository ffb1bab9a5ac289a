"""`python -m robotapp_testbed.images OUT_DIR [NAME…]`: write the archives as OUT_DIR/NAME.tar (scripts/build images)."""

import argparse
import shutil
import sys
from pathlib import Path

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.images import RECIPES, archive, reference


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="scripts/build images", description="OCI archives, built without Docker")
    parser.add_argument("out", type=Path, metavar="OUT_DIR")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(RECIPES)}; all when none is given")
    arguments = parser.parse_args(argv)
    arguments.out.mkdir(parents=True, exist_ok=True)
    try:
        for name in arguments.names or RECIPES:
            target = arguments.out / f"{name}.tar"
            shutil.copyfile(archive(name), target)
            print(f"{target}  {reference(name)}  {target.stat().st_size / 1e6:.0f} MB")
    except TestbedError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
