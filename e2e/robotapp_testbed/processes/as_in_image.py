"""Run as a script: become a module without the packages that only tests have, as it runs in its image.

    python as_in_image.py MODULE [ARGUMENT…]

kopf imports the kubernetes client where one is installed: a quarter of the CPU that the operator's start takes. Uses
nothing of the package, whose import would take as long.
"""

import runpy
import sys

ABSENT = ("kubernetes",)


def main() -> None:
    sys.modules.update(dict.fromkeys(ABSENT))  # type: ignore[arg-type]  # None is how an import is refused
    sys.path[0] = ""  # as with `python -m`: not the folder of this script
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
