"""`python -m t2twin` is `t2twin`."""

from t2twin.cli import main

main()
