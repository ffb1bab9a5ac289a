"""Entry point of `python -m robotapp_scheduler`."""

import sys

from robotapp_scheduler.main import main

sys.exit(main())
