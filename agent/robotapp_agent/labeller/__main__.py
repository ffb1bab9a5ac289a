"""`python -m robotapp_agent.labeller`."""

import sys

from robotapp_agent.labeller.main import main

sys.exit(main())
