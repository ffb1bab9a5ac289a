"""`python -m robotapp_agent.driver`."""

import sys

from robotapp_agent.driver.main import main

sys.exit(main())
