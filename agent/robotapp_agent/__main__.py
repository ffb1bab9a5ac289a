"""`python -m robotapp_agent`."""

import sys

from robotapp_agent.main import main

sys.exit(main())
