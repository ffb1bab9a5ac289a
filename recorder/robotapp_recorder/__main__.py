"""`python3 -m robotapp_recorder`."""

from robotapp_recorder.main import main

if __name__ == "__main__":
    raise SystemExit(main())
