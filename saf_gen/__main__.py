"""Entry point of ``python -m saf_gen``, which runs the command ``saf-gen``."""

from saf_gen.cli import main

if __name__ == "__main__":
    main()
