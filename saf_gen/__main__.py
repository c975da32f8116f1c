"""``python -m saf_gen`` is the command ``saf-gen``."""

from saf_gen.cli import main

if __name__ == "__main__":
    main()
