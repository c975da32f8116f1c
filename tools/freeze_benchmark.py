"""Freeze a recipe that comes with saf_gen as a benchmark: write its digest into recipes/frozen.json.

    python tools/freeze_benchmark.py saf_bench

From then on, a recipe of this name that would give other spikes is rejected, and results name the benchmark. A frozen
benchmark never changes; a different one needs another name.
"""

import argparse
import json
import sys
from collections import Counter
from datetime import UTC, datetime

from saf_gen.core.config.frozen_benchmarks import FILE_NAME, FrozenBenchmark, read_frozen_digests
from saf_gen.core.files import write_text
from saf_gen.core.shipped import shipped_folder
from saf_gen.errors import BadInput
from saf_gen.generate.resolve import recipe_digest, resolve_recipe


def freeze(name: str) -> str:
    """Add the digest of the recipe ``name`` to the list, and return it.

    Raises BadInput if the recipe is already frozen with another digest.
    """
    resolved, frozen = resolve_recipe(name), read_frozen_digests()
    digest = recipe_digest(resolved)
    if name in frozen and frozen[name].digest != digest:
        raise BadInput(f"{name} was frozen on {frozen[name].since} with another digest", hint="choose another name")
    if name not in frozen:
        counts = Counter(s.planned.split for s in resolved.all_sequences)
        frozen = {
            **frozen,
            name: FrozenBenchmark(digest=digest, since=datetime.now(UTC).date(), sequences=dict(counts)),
        }
        text = json.dumps({"benchmarks": {key: one.model_dump(mode="json") for key, one in frozen.items()}}, indent=1)
        write_text(shipped_folder("recipes") / FILE_NAME, text + "\n")
    return digest


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name")
    try:
        print(freeze(parser.parse_args().name))
    except BadInput as error:
        sys.exit(str(error))
