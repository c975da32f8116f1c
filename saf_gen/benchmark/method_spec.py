"""Names of methods, which combine a focus measure and a search with their options, and files of tuned methods.

``sd_code+sgfs_code:dt=50`` is the measure ``sd_code`` with the search ``sgfs_code``, whose option ``dt`` is 50.
``sd+argmax@frame`` looks at the whole frame, whatever region the other methods look at.
``@FILE`` is the method of a tuned file, which states the constants that were tried, the data, and the best constants.
``my_method/`` is the method in a folder with a card (:mod:`saf_gen.benchmark.method_folder`).
"""

import hashlib
import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from inspect import signature
from pathlib import Path
from typing import Any, ClassVar, Protocol

from pydantic import ConfigDict

from saf_gen.benchmark.method_folder import CARD, MethodCard, ends_as_folder, file_in, folder_name, read_card
from saf_gen.benchmark.records import Count, Number, Who, pop_format
from saf_gen.benchmark.view.operations import DeclaredCost
from saf_gen.benchmark.view.restricted_view import MeteredScorer
from saf_gen.core.config.document import STRICT, read_text, validate_document
from saf_gen.core.config.json_document import format_checked_json, parse_checked_json
from saf_gen.core.config.registry import FORM_SUFFIXES, names, plugin_class, refuse_code
from saf_gen.core.config.source_digest import class_source_digests
from saf_gen.core.cores import describe_machine
from saf_gen.core.region import REGIONS
from saf_gen.errors import BadInput, closest, unknown
from saf_gen.parts import Answer, Measure, Search, wants_measures
from saf_gen.plugins.measures import get_measure, measure_names
from saf_gen.plugins.searches import REJECT, Rejecting, get_search, search_names

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
    "structure_calibrated+photon_aware",
    "octave_structure+peak_fit",
    "fine_structure+bell_vote",
)
"""Methods that ``saf-gen evaluate`` runs by default: the paper's measures and searches, two of these measures in
brightness-normalised form (SD is normalised already), and five more methods."""

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
"""Methods that ``saf-gen evaluate --track closed_loop`` runs by default."""

BASELINES = "baselines"
"""Name that stands for all of these methods of a track, in lists of methods."""

MAX_STATED = 4000
"""Largest number of characters in which a record states a measure, or a search, with its options."""
TUNING_FORMAT = "saf-gen tuning 1"
TUNE_HINT = "make it with saf-gen tune"


Half = tuple[str, dict[str, Any]]
"""Name and options of a measure or a search."""


class MethodGuest(Protocol):
    """A process that runs a method of others; see :class:`saf_gen.benchmark.guests.guest.Guest`."""

    limits: Any
    names: tuple[str, str]
    cost: DeclaredCost
    plugins: list[dict[str, Any]]
    search_options: dict[str, Any]

    def run(self, view: Any, *, scorer: MeteredScorer, stream_path: str = "") -> tuple[Answer, str]: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class Method:
    """A focus measure and a search with their common name, ready to run."""

    name: str
    measure: Measure
    search: Search
    code: str
    """First 12 digits of a SHA-256 over the options and the source code of the measure, the search, and other measures
    that the search uses."""
    tuning: str = ""
    """First 12 digits of the SHA-256 of the tuned file that named the method (``@FILE``), or ''."""
    region: str = ""
    """Region that the method looks at, one of REGIONS; '' leaves the choice to the evaluation."""
    guest: "MethodGuest | None" = None
    """Process that runs the method, whose measure and search then only state what they are; None for methods of
    saf_gen, which run in the evaluator."""

    @property
    def measure_name(self) -> str:
        return split_halves(split_region(self.name)[0])[0]

    @property
    def search_name(self) -> str:
        """Name of the search, '' for a method in a folder."""
        return split_options("".join(split_halves(split_region(self.name)[0])[1:]))[0]

    @property
    def search_options(self) -> dict[str, Any]:
        """Options of the search, by the names of its fields."""
        if self.guest is not None:
            return self.guest.search_options
        return options_of(self.search)

    @property
    def parameters(self) -> str:
        """Measure and search with every option, in the form that records store; long options by length and digest."""
        return f"{_state(self.measure)} + {_state(self.search)}"

    def who(self, region: str) -> Who:
        """Return what records say of the method, if it runs on this machine and looks at a region."""
        return Who(
            self.name,
            self.code,
            region,
            self.parameters,
            limits=str(self.guest.limits) if self.guest else "",
            tuning=self.tuning,
            machine=describe_machine(),
        )


def _state(part: Any) -> str:
    """Return a measure or a search with its options, in at most MAX_STATED characters, because every record has it."""
    text = repr(part)
    if len(text) > MAX_STATED and is_dataclass(part):
        values = {field.name: getattr(part, field.name) for field in fields(part)}
        stated = {name: _state(one) if is_dataclass(one) else shorten(repr(one)) for name, one in values.items()}
        text = f"{type(part).__qualname__}({', '.join(f'{name}={one}' for name, one in stated.items())})"
    return shorten(text, MAX_STATED)


def shorten(text: str, limit: int = 500) -> str:
    """Return a text or, if it is longer than ``limit``, its number of characters and 12 digits of their SHA-256."""
    if len(text) <= limit:
        return text
    return f"<{len(text):,} characters, {hashlib.sha256(text.encode(errors='backslashreplace')).hexdigest()[:12]}>"


def options_of(search: Any) -> dict[str, Any]:
    """Return the options of a search, by the names of its fields; of one that rejects, its own and ``reject``."""
    if isinstance(search, Rejecting):
        return {**options_of(search.search), REJECT: True}
    return {field.name: getattr(search, field.name) for field in fields(search)} if is_dataclass(search) else {}


def parse_method(spec: str) -> Method:
    """Return the method with the given name.

    Parameters
    ----------
    spec : str
        ``MEASURE[:KEY=VALUE,...]+SEARCH[:KEY=VALUE,...][@REGION]``, or ``@FILE[@REGION]`` for the method of a tuned
        file, or the path of a folder with a card. MEASURE and SEARCH are registered names, or
        ``package.module:Class`` or ``file.py:Class``, whose module is executed. A tuned file may name only plug-ins
        that are registered or already loaded.

    Returns
    -------
    Method
        The method, ready to run.

    Raises
    ------
    BadInput
        If the name is malformed, if the measure, search or region is unknown, or if a plug-in refuses its options.
    """
    if spec.startswith("@"):
        return tuned_method(spec, parse_method)
    name, region = split_region(spec)
    if name := folder_name(name):
        measure, search = read_folder(Path(name)).halves
        if (folder := str(Path(name).resolve())) not in sys.path:
            sys.path.insert(0, folder)  # its modules may import each other
        try:
            built = build_method(measure, search)
        except BadInput as error:
            raise of_method(error, spec) from None
        return replace(built, name=f"{name}@{region}" if region else name, region=region)
    halves, text, region = split_method(spec)
    measure, search = (parse_options(half, spec) for half in halves)
    try:
        built = build_method(measure, search)
    except BadInput as error:
        raise of_method(error, spec) from None
    return replace(built, name=f"{text}@{region}" if region else text, region=region)


def tuned_method(spec: str, parse: Callable[[str], Method]) -> Method:
    """Return the method of a tuned file, ``@FILE[@REGION]``, as ``parse`` makes it of the name in the file."""
    path, region = split_region(spec[1:])
    tuned, digest = read_tuned(path)
    if tuned.method.startswith("@"):
        raise BadInput(
            f"{spec[1:]} names another tuned file, {tuned.method!r}", allowed="MEASURE+SEARCH in a tuned file"
        )
    method = f"{split_region(tuned.method)[0]}@{region}" if region else tuned.method
    with refuse_code(path):
        return replace(parse(method), tuning=digest)


def of_method(error: BadInput, spec: str) -> BadInput:
    """Return an error that says which method it concerns."""
    hint = error.hint or "`saf-gen methods list` shows measures and searches"
    where = f"method {spec!r}"
    return BadInput(error.problem, where=where, allowed=error.allowed, nearest=error.nearest, hint=hint)


def _example_with(half: str) -> str:
    """Return a method with a measure or a search."""
    if split_options(half)[0] not in names("searches"):
        return f"{half or 'sd'}+argmax"
    return f"{'er_count' if '_events' in half else 'sd'}+{half}"


def split_method(spec: str) -> tuple[list[str], str, str]:
    """Return the measure and the search in a name, the name without its region, and the region."""
    text, region = split_region(spec)
    halves = [tidy(half) for half in split_halves(text)]
    text = "+".join(halves)
    if len(halves) != 2 or not all(halves):
        raise BadInput(
            f"method {spec!r} is not a focus measure and a search",
            allowed="MEASURE+SEARCH, options after a colon, like sd_code+sgfs_code:dt=50",
            nearest=(near := closest(text, {BASELINES} - {text})),
            hint=f"name its folder: {Path(text).parent}/"
            if Path(text).name == CARD
            else ""
            if near
            else f"try {_example_with(halves[0])}; `saf-gen methods list` shows measures and searches",
        )
    measure, search = (split_options(half)[0] for half in halves)
    if measure in names("searches") and search in measure_names():
        raise BadInput(f"method {spec!r} names the search first", nearest="+".join(reversed(halves)))
    return halves, text, region


@dataclass(frozen=True)
class MethodFolder:
    """A method in a folder: its card, its measure and search with absolute paths, and the files that it names."""

    card: MethodCard
    halves: tuple[Half, Half]
    files: tuple[Path, ...]


def read_folder(folder: Path) -> MethodFolder:
    """Return the method in a folder.

    Raises BadInput in one line if its card is missing or not valid, or names a file that is missing or outside the
    folder.
    """
    card, where = read_card(folder), str(folder / CARD)
    files = [(folder / CARD).resolve(), *(file_in(folder, name, where=where) for name in card.files)]

    def find(value: Any) -> Any:
        """Return an option of the card with absolute paths."""
        path, _, member = value.rpartition(":") if isinstance(value, str) else ("", "", "")
        if path.endswith(".py"):
            files.append(file_in(folder, path, where=where))
            return f"{files[-1]}:{member}"
        if isinstance(value, str) and (folder / value).is_file():
            files.append(file_in(folder, value, where=where))
            return str(files[-1])
        return value

    halves = []
    for key in ("measure", "search"):
        name, options = parse_options(tidy(getattr(card, key)), f"{where}: {key}")
        path, colon, member = name.rpartition(":")
        if (colon and not (path.endswith(".py") and member)) or name.endswith(".py"):
            raise BadInput(
                f"the {key} is {name.rstrip(':')!r}",
                where=where,
                allowed="file.py:Name of a file in the folder, or a registered name",
            )
        halves.append((find(name) if colon else name, {option: find(value) for option, value in options.items()}))
    return MethodFolder(card, (halves[0], halves[1]), tuple(files))


def build_method(measure: Half, search: Half) -> Method:
    """Return the method of a measure and a search, each a name with options, in this process.

    Raises BadInput if one of them is unknown or refuses its options.
    """
    plugins = get_measure(measure[0], **measure[1]), get_search(search[0], **search[1])
    others = [get_measure(name) for name in wants_measures(plugins[1])]
    return Method(f"{measure[0]}+{search[0]}", *plugins, code=_digest_code([*plugins, *others]))


def split_region(method: str) -> tuple[str, str]:
    """Return the name of a method without its region, and the region, or '' if the name has no region.

    Raises BadInput if the region is unknown.
    """
    name, at, region = method.strip().rpartition("@")
    region = region.strip()
    if not at or set(region) & set("+/.:"):  # this @ belongs to the path of a file or to an option of the measure
        return method.strip(), ""
    if region not in REGIONS:
        raise unknown("region", region, allowed=REGIONS, where=f"method {method!r}")
    return name, region


def split_halves(name: str) -> list[str]:
    """Return the measure and the search in a name without a region; another number of parts if it is no method.

    A method in a folder has one part.

    A + is a sign of the method unless it is in the path of a file, which ends in ``.py:``.
    """
    if ends_as_folder(name):
        return [name]
    pieces = name.split("+")
    for count in range(len(pieces) - 1, 0, -1):
        halves = ["+".join(pieces[:count]), "+".join(pieces[count:])]
        if all("+" not in half or ".py:" in half.rpartition("+")[2] for half in halves):
            return halves
    return pieces


def measure_and_search(name: str) -> tuple[str, str]:
    """Return the measure and the search of a method with their options, or the name and '' for predictions."""
    measure, *search = split_halves(name)
    return measure, search[0] if search else ""


def split_options(half: str) -> tuple[str, str]:
    """Return the name of a measure or search, and its options as a string."""
    file = _FILE.match(half)
    path, rest = (file[1], half[file.end() :]) if file and not _OPTION.match(file[1]) else ("", half)
    name, _, tail = rest.partition(":")
    if path:
        return f"{path}:{name}", tail
    if "." in name:  # package.module:Class
        cls, _, tail = tail.partition(":")
        name = f"{name}:{cls}"
    return name, tail


_FILE = re.compile(r"(.+?\.py):")
_OPTION = re.compile(r"\w+:\w+=")
"""Beginning of a registered name with an option, whose value may name a file."""


def tidy(half: str) -> str:
    """Return the name of a measure or search without the blanks that mean nothing; a path keeps its own."""
    half = half.strip()
    name, _ = split_options(half)
    path = name.rpartition(":")[0] if ".py:" in name else ""
    return path + re.sub(r"\s*([:,=])\s*", r"\1", half[len(path) :]).strip()


def parse_options(half: str, spec: str) -> tuple[str, dict[str, Any]]:
    """Return the name of a measure or search, and its parsed options.

    Raises BadInput, which quotes the full method name ``spec``, if an option is malformed.
    """
    name, tail = split_options(half)
    options: dict[str, Any] = {}
    for item in tail.split(",") if tail else ():
        key, equals, value = item.partition("=")
        if not (key and equals and value):
            near = spec.replace(half, f"{name}.py:{tail}", 1) if Path(f"{name}.py").is_file() else ""
            problem = f"malformed option {item!r} of method {spec!r}"
            raise BadInput(problem, allowed="KEY=VALUE, separated by commas", nearest=near)
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
    """Return 12 digits of a digest over plug-ins: their options, and the source code of everything that they use.

    It includes helpers that they import from their folder, and measures that they wrap, because a change in these can
    change results.
    """
    written = [
        [repr(plugin) for plugin in plugins],
        class_source_digests(type(nested) for plugin in plugins for nested in nested_plugins(plugin)),
    ]
    return hashlib.sha256(json.dumps(written).encode()).hexdigest()[:12]


def nested_plugins(plugin: object) -> Iterator[object]:
    """Yield a plug-in and all plug-ins that it wraps."""
    if is_dataclass(plugin):
        yield plugin
        for field in fields(plugin):
            yield from nested_plugins(getattr(plugin, field.name))


def named_measures(search: object) -> tuple[str, ...]:
    """Return the names of the measures by which a search finds its answer, besides the method's.

    Those of the rule of ``reject`` are left out, because it gives no answer: it withdraws one.
    """
    return wants_measures(search.search if isinstance(search, Rejecting) else search)


def resolve_name(spec: str) -> Method | tuple[str, Any]:
    """Return the method of a given name, or the kind (``measures`` or ``searches``) and the plug-in of that name.

    Raises BadInput if nothing has this name, or if the plug-in refuses its options.
    """
    name = split_region(spec)[0]
    if spec.startswith("@") or folder_name(name) or len(split_halves(name)) > 1:
        return parse_method(spec)
    return find_plugin(parse_options(tidy(spec), spec))


def find_plugin(half: Half, kind: str = "") -> tuple[str, Any]:
    """Return the kind and the plug-in of a name with options, of a kind that is known or else found out.

    Raises BadInput if nothing has this name, or if the plug-in refuses its options.
    """
    name, options = half
    kind = kind or _find_kind(name)
    return kind, get_measure(name, **options) if kind == "measures" else get_search(name, **options)


def _find_kind(name: str) -> str:
    if name in names("searches"):
        return "searches"
    bare = name
    while bare.endswith(FORM_SUFFIXES) and bare not in names("measures"):
        bare = next(bare.removesuffix(suffix) for suffix in FORM_SUFFIXES if bare.endswith(suffix))
    if bare in names("measures"):
        return "measures"
    if ":" not in name:
        raise unknown("measure or search", name, allowed=[*measure_names(), *search_names()])
    cls = _load_class(name, bare)
    plain = getattr(cls, "plain", None)
    if plain is not None and not any(hasattr(plain, member) for member in ("degree", "score_range", "halves")):
        return "searches" if has_view_parameter(plain) else "measures"
    if bare != name or any(hasattr(cls, member) for member in ("degree", "score_range", "halves")):
        return "measures"
    if any(hasattr(cls, member) for member in ("causal", "commands")):
        return "searches"
    raise BadInput(
        f"{name!r} is neither a measure nor a search",
        allowed="a class that states degree (a measure) or causal (a search)",
        hint=f"state one of them, or check a complete method: {name}+argmax",
    )


def has_view_parameter(plain: Any) -> bool:
    """Return whether one of the first two parameters of a plain function, or of a plain class's calls, is ``view``."""
    called = plain.__call__ if isinstance(plain, type) else plain
    return "view" in list(signature(called).parameters)[:2]


def _load_class(name: str, bare: str) -> type:
    """Return the class called ``name`` or, if it does not exist, the class called ``bare``.

    ``bare`` is ``name`` without the suffixes ``_n`` and ``_tfi``. The full name is tried first, because the name of a
    class may end like this.
    """
    try:
        return plugin_class("measures", name)
    except BadInput:
        if bare == name:
            raise
        return plugin_class("measures", bare)


@dataclass(frozen=True)
class TuningTrial:
    """One choice of constants, with its success within one depth of focus by the rule of the file, and its error.

    ``objective`` is what tuning maximised; None in files from before there was one.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    method: str
    success_1dof: Number | None
    median_error_dof: Number | None
    objective: Number | None = None


@dataclass(frozen=True)
class TunedMethod:
    """The best of the tuning trials, and how it was found.

    ``data`` is the first 12 digits of a SHA-256 over the content_sha256 of the sequences, in their order. ``ranked_by``
    is the rule of the success: ``success_1dof``, in which an abstention is right where there is no answer, in files
    from before there was another.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    method: str
    dataset: str
    split: str
    track: str
    terms: str
    region: str
    sequences: Count
    data: str
    version: str
    trials: tuple[TuningTrial, ...]
    ranked_by: str = "success_1dof"


def format_tuned(tuned: TunedMethod) -> str:
    """Return the text of the file of a tuned method."""
    return format_checked_json({"format": TUNING_FORMAT, **asdict(tuned)}, indent=1) + "\n"


def read_tuned(path: str | Path) -> tuple[TunedMethod, str]:
    """Read a tuned file, and return its contents and the first 12 digits of its SHA-256.

    Raises BadInput if the file cannot be read, or was not made by ``saf-gen tune`` of this version.
    """
    path = Path(path)
    document = parse_checked_json(read_text(path, hint=TUNE_HINT), path, hint=TUNE_HINT)
    pop_format(document, TUNING_FORMAT, what="tuned method", hint=TUNE_HINT)
    tuned = validate_document(TunedMethod, document, hint=TUNE_HINT)
    return tuned, hashlib.sha256(path.read_bytes()).hexdigest()[:12]
