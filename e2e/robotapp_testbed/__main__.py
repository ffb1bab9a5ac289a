"""See `python -m robotapp_testbed --help`."""

import sys

from robotapp_testbed.cli import main

sys.exit(main())
