"""`python -m translate` is `t2twin`."""

from translate.cli import main

main()
