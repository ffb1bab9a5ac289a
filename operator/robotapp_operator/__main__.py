import sys

from robotapp_operator.main import main

sys.exit(main())
