"""Constants of a method that were tuned, as a file says them: what was tried, on which data, what came best.

``@FILE`` is then the method's name wherever a method is named, and every record that it makes cites the file
by its digest.
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from saf_gen.errors import BadInput, closest

__all__ = ["TunedMethod", "TuningTrial", "format_tuned_method", "read_tuned_method"]

FORMAT = "saf-gen tuning 1"


@dataclass(frozen=True)
class TuningTrial:
    """One choice of constants: its success within one depth of focus and median error in them, or None."""

    method: str
    success_1dof: float | None
    median_error_dof: float | None


@dataclass(frozen=True)
class TunedMethod:
    """The best of the trials, and how it was found.

    ``data``: 12 digits of a sha256 over the content_sha256 of the sequences, in their order.
    """

    method: str
    dataset: str
    split: str
    track: str
    terms: str
    region: str
    sequences: int
    data: str
    version: str
    trials: tuple[TuningTrial, ...]


def format_tuned_method(tuned: TunedMethod) -> str:
    """The file's text."""
    return json.dumps({"format": FORMAT, **asdict(tuned)}, indent=1, ensure_ascii=False) + "\n"


def read_tuned_method(path: str | Path) -> tuple[TunedMethod, str]:
    """What a file says, and 12 digits of its sha256.

    Raises BadInput where there is none, or it was not made by `saf-gen tune`.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        near = closest(path.name, [p.name for p in path.parent.glob("*.json")])
        raise BadInput(
            f"{path} cannot be read: {error.strerror or error}",
            nearest=near,
            hint="make it with saf-gen tune",
        ) from error
    try:
        said: dict[str, Any] = json.loads(raw)
        if said.pop("format") != FORMAT or not isinstance(said["method"], str):
            raise ValueError
        trials = tuple(TuningTrial(**trial) for trial in said.pop("trials"))
        tuned = TunedMethod(**said, trials=trials)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise BadInput(
            f"{path} holds no tuned constants of this version",
            allowed=f'"format": "{FORMAT}"',
            hint="make it with saf-gen tune",
        ) from error
    return tuned, hashlib.sha256(raw).hexdigest()[:12]
