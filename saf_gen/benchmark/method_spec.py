"""Names of methods: a focus measure and a search, with their options, parsed once.

``sd_code+sgfs_code:dt=50`` is the measure ``sd_code`` searched by ``sgfs_code`` with ``dt`` at 50;
``sd+argmax@frame`` looks at the whole frame, wherever the others look.
"""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from saf_gen.benchmark.tuned_method import read_tuned_method
from saf_gen.core.config.document import read_text
from saf_gen.core.config.registry import refuse_code_named_in_file
from saf_gen.core.config.source_digest import class_source_digests
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, unknown
from saf_gen.parts import Measure, Search, wants_measures
from saf_gen.plugins.measures import get_measure
from saf_gen.plugins.searches import get_search

DEFAULT_RECORDED_METHODS = (
    *(
        f"{measure}+argmax"
        for measure in ["sd", "sd_code", "er_sumsq", "er_count", "gradient_code", "mfdct_code", "mfdct_lee"]
    ),
    *(f"{measure}+argmax" for measure in ("gradient_code_n", "mfdct_lee_n")),
    *(
        f"{measure}+{search}"
        for search in ("egs_code", "sgfs_code")
        for measure in ("sd_code", "er_sumsq", "gradient_code", "mfdct_code")
    ),
    "cen+argmax",
    "sd+sgfs_causal",
    "sd_calibrated+photon_aware",
    "structure_calibrated+photon_aware",
    "octave_structure+peak_fit",
)
"""What `saf-gen evaluate` runs when no method is named: the paper's measures and searches, two of its
baselines divided by brightness, as SD is, and five more."""

DEFAULT_CLOSED_LOOP_METHODS = (
    "octave_structure+peak_fit",
    "structure_calibrated+photon_aware",
    "sd_calibrated+photon_aware",
    *(
        f"{measure}+{search}"
        for search in ("egs_code", "sgfs_code", "sgfs_causal")
        for measure in ("sd_code", "gradient_code", "mfdct_code", "er_sumsq")
    ),
    *(
        f"{measure}+{search}"
        for search in ("golden_section", "fibonacci", "hill_climb", "rule_based", "coarse_to_fine")
        for measure in ("sd", "gradient_code_n")
    ),
)
"""What `saf-gen evaluate --track closed_loop` runs when no method is named."""

MAX_LIST_BYTES = 1 << 22


@dataclass(frozen=True)
class Method:
    """A focus measure with a search, by name and ready to run."""

    name: str
    measure: Measure
    search: Search
    code: str
    """12 digits of a sha256 over the options and the source of both plug-ins: what made the numbers."""
    tuning: str = ""
    """12 digits of the sha256 of the tuned file that named the method (``@FILE``), or ''."""
    region: str = ""
    """The region that the method looks at, one of REGIONS; '' leaves the choice to the evaluation."""

    @property
    def measure_name(self) -> str:
        return self.name.split("+")[0]

    @property
    def search_name(self) -> str:
        return split_method_options(split_method_region(self.name)[0].split("+")[1])[0]

    @property
    def parameters(self) -> str:
        """Measure and search with every option, as records carry them."""
        return f"{self.measure!r} + {self.search!r}"


def parse_method(spec: str) -> Method:
    """Return the method that a name stands for.

    Parameters
    ----------
    spec : ``MEASURE[:KEY=VALUE,...]+SEARCH[:KEY=VALUE,...][@REGION]``, or ``@FILE`` for the method of a tuned file.
        MEASURE and SEARCH are registered names, or ``package.module:Class`` or ``file.py:Class``, whose module is run;
        a tuned file may name only what is registered or was loaded before.

    Raises
    ------
    BadInput : for a malformed name, an unknown measure, search or region, and options that are refused.
    """
    if spec.startswith("@"):
        path, region = split_method_region(spec[1:])
        tuned, digest = read_tuned_method(path)
        if tuned.method.startswith("@"):
            raise BadInput(f"{spec[1:]} names {tuned.method!r}", allowed="MEASURE+SEARCH in a tuned file")
        method = f"{split_method_region(tuned.method)[0]}@{region}" if region else tuned.method
        with refuse_code_named_in_file(path):
            return replace(parse_method(method), tuning=digest)
    text, region = split_method_region("".join(spec.split()))
    halves = text.split("+")
    if len(halves) != 2 or not all(halves):
        raise BadInput(
            f"method {spec!r} is not a focus measure and a search",
            allowed="MEASURE+SEARCH, options after a colon, like sd_code+sgfs_code:dt=50",
            hint=f"try {halves[0] or 'sd'}+argmax; `saf-gen methods` lists measures and searches",
        )
    (measure, measure_options), (search, search_options) = (parse_method_options(half, spec) for half in halves)
    try:
        plugins = get_measure(measure, **measure_options), get_search(search, **search_options)
        others = [get_measure(name) for name in wants_measures(plugins[1])]
    except BadInput as error:
        raise BadInput(
            error.problem,
            where=f"method {spec!r}",
            allowed=error.allowed,
            nearest=error.nearest,
            hint=error.hint or "`saf-gen methods` lists measures and searches",
        ) from None
    name = f"{text}@{region}" if region else text
    return Method(name, *plugins, code=_digest_code([*plugins, *others]), region=region)


def split_method_region(method: str) -> tuple[str, str]:
    """Return the name of a method without its region, and the region, '' for none.

    Raises BadInput for an unknown region.
    """
    name, at, region = method.rpartition("@")
    if not at or set(region) & set("+/.:"):  # an @ elsewhere: in a file's path, in an option of the measure
        return method, ""
    if region not in REGIONS:
        raise unknown("region", region, allowed=REGIONS, where=f"method {method!r}")
    return name, region


def split_method_options(half: str) -> tuple[str, str]:
    """Return the name of a measure or search, and its options as text."""
    name, _, tail = half.partition(":")
    if "." in name:  # package.module:Class, or file.py:Class
        cls, _, tail = tail.partition(":")
        name = f"{name}:{cls}"
    return name, tail


def parse_method_options(half: str, spec: str) -> tuple[str, dict[str, Any]]:
    """Return the name of a measure or search, and its options; errors name the whole method ``spec``."""
    name, tail = split_method_options(half)
    options: dict[str, Any] = {}
    for item in tail.split(",") if tail else ():
        key, equals, value = item.partition("=")
        if not (key and equals and value):
            raise BadInput(f"option {item!r} of method {spec!r}", allowed="KEY=VALUE, separated by commas")
        options[key] = _parse_value(value)
    return name, options


def _parse_value(text: str) -> Any:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return {"true": True, "false": False}.get(text.lower(), text)


def _digest_code(plugins: Sequence[Measure | Search]) -> str:
    """Return 12 digits over plug-ins with their options, their source, and the source that this imports.

    Plug-ins import helpers from beside them, and a brightness-normalised measure wraps another: a change in
    any of these moves numbers.
    """
    written = [
        [repr(plugin) for plugin in plugins],
        class_source_digests(type(nested) for plugin in plugins for nested in _find_nested(plugin)),
    ]
    return hashlib.sha256(json.dumps(written).encode()).hexdigest()[:12]


def _find_nested(plugin: object) -> Iterator[object]:
    """Yield a plug-in and the plug-ins that it wraps."""
    if is_dataclass(plugin):
        yield plugin
        for field in fields(plugin):
            yield from _find_nested(getattr(plugin, field.name))


def read_method_list(path: Path) -> list[str]:
    """Return the names in a list of methods, one per line, without empty lines and comments after ``#``.

    A list runs no code of its own: it names what is registered, or what this process has loaded before.

    A comment begins a line, or follows a space and is followed by one. Raises BadInput with the line for a
    name that cannot be parsed, and for a list that cannot be read or is empty.
    """
    try:
        text = read_text(path, most=MAX_LIST_BYTES, encoding="utf-8-sig")
    except BadInput as error:
        problem = f"this is not a list of methods: {error.problem}"
        raise BadInput(problem, allowed="a text file, one method per line", nearest=error.nearest) from error
    names = []
    for number, line in enumerate(text.splitlines(), 1):
        if name := "" if line.startswith("#") else line.partition(" # ")[0].strip():
            try:
                with refuse_code_named_in_file(str(path)):
                    parse_method(name)
            except BadInput as error:
                raise BadInput(str(error), where=f"{path}:{number}") from error
            names.append(name)
    if not names:
        raise BadInput(f"{path} names no method", allowed="one method per line, such as sd+argmax")
    return names
