"""Entry point of the command ``saf-gen``, and of ``python -m saf_gen``."""

import os
from typing import NoReturn

from saf_gen.core.cores import count_startable, usable_cores


def main() -> NoReturn:
    """Run the command of this process's arguments, and exit; see :func:`saf_gen.cli.main`."""
    # If numpy's OpenBLAS cannot start its threads, it prints lines and interrupts the program that imports it.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", str(max(1, count_startable(usable_cores()))))
    from saf_gen.cli import main

    main()


if __name__ == "__main__":
    main()
