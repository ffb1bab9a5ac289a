import sys

from robotapp_console.main import main

sys.exit(main())
