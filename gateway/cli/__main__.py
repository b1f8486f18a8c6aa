"""`python -m gateway.cli` is `ta2`."""

from gateway.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
