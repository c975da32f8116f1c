"""``python -m studies.laws``."""

import sys

from studies.laws.run import main

if __name__ == "__main__":
    sys.exit(main())
