"""``python -m evrig``: the command line."""

from ._cli import main

main()
