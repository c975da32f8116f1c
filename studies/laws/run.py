"""Checks laws one after the other and keeps what is found, so that an interrupted run can be resumed.

python -m studies.laws [--quick] [--only NAME]... [--out FOLDER]

With ``--only``, the sections of other laws stay on the page as they are.
"""

import argparse
import hashlib
import json
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import saf_gen
from saf_gen.core.extras import RENDERER, require_extra
from saf_gen.core.files import check_writable, write_text
from saf_gen.errors import SafGenError, unknown
from studies.laws import (
    colour,
    convergence,
    dispersion,
    drives,
    events,
    frames,
    lenses,
    light,
    noise,
    optics,
    photons,
    radiometry,
    referee,
    sections,
    truth,
)
from studies.laws.law import Comparison, Curve, Finding, Law, Plot, Skipped
from studies.laws.page import write_page
from studies.laws.workload import DatasetMaker

LAWS = {
    law.name: law
    for module in (
        optics,
        lenses,
        colour,
        sections,
        drives,
        radiometry,
        noise,
        photons,
        frames,
        events,
        light,
        truth,
        convergence,
        dispersion,
        referee,
    )
    for law in module.LAWS
}
"""Every law by its name, in the order of the page."""
KEPT = ".validation"
"""Folder for findings and datasets, next to the page; it may be deleted."""


def choose_laws(names: Sequence[str]) -> list[Law]:
    """Return the laws with these names, or all laws if ``names`` is empty; a subject selects all its laws.

    Raises BadInput if a name is neither a law nor a subject.
    """
    subjects = dict.fromkeys(law.subject for law in LAWS.values())
    for name in names:
        if name not in LAWS and name not in subjects:
            raise unknown("law", name, allowed=[*subjects, *LAWS])
    return [law for law in LAWS.values() if not names or law.name in names or law.subject in names]


def check_laws(
    laws: Sequence[Law],
    folder: Path,
    *,
    quick: bool = False,
    show: Callable[[Law, Finding], None] = lambda law, found: None,
) -> dict[str, Finding]:
    """Check laws and return their findings by name.

    The finding of a law that passed or failed is kept in ``folder`` at once, and used again at the same size and with
    the same code. Datasets are deleted when all laws have been checked, and kept if the run is interrupted.

    Parameters
    ----------
    laws : sequence of Law
        Laws to check, such as :func:`choose_laws` returns.
    folder : Path
        Folder of the page; findings and datasets are in its subfolder ``.validation``.
    quick : bool, default False
        Whether to check the small sizes.
    show : callable, optional
        Called with each law and its finding.

    Raises
    ------
    BadInput
        If the folder cannot be written.
    """
    check_writable(folder)
    code = fingerprint()[:12]
    for other in (folder / KEPT).glob("*"):  # findings and datasets of other code are of no use
        if not other.name.startswith(code):
            shutil.rmtree(other, ignore_errors=True)
    home = folder / KEPT / f"{code}-{'quick' if quick else 'whole'}"
    maker, findings = DatasetMaker(home / "datasets"), {}
    for law in laws:
        file = home / f"{law.name}.json"
        findings[law.name] = found = _read(file) if file.is_file() else _find(law, maker, quick=quick)
        if not found.reason:
            write_text(file, json.dumps(asdict(found), ensure_ascii=False))
        show(law, found)
    maker.clear()
    return findings


def fingerprint() -> str:
    """Return the SHA-256 (hex) of all code and presets of saf_gen and of the laws."""
    digest = hashlib.sha256()
    for folder in (Path(saf_gen.__file__).resolve().parent, Path(__file__).resolve().parent):
        for path in sorted(p for p in folder.rglob("*") if p.suffix in (".py", ".yaml")):
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _find(law: Law, maker: DatasetMaker, *, quick: bool) -> Finding:
    """Check one law; an error of saf_gen is the reason of its finding, and the other laws are checked all the same."""
    try:
        return law.check(maker, quick)
    except Skipped as reason:
        return Finding((), reason=str(reason), skipped=True)
    except SafGenError as error:
        return Finding((), reason=str(error))


def _read(file: Path) -> Finding:
    found = json.loads(file.read_text(encoding="utf-8"))
    plot = found["plot"]
    curves = (
        ()
        if plot is None
        else tuple(Curve(**one | {key: tuple(one[key]) for key in ("x", "y", "error")}) for one in plot["curves"])
    )
    return Finding(
        tuple(Comparison(**one) for one in found["comparisons"]),
        plot and Plot(**plot | {"curves": curves, "names": tuple(plot["names"])}),
        tuple(found["remarks"]),
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Check the laws that the arguments name, print and write what was found, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m studies.laws", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="check small sizes, in about a minute")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="a law, or a subject such as noise")
    parser.add_argument("--out", type=Path, default=Path("datasets/validation"), help="folder of validation.md")
    options = parser.parse_args(argv)
    try:
        laws = choose_laws(options.only)
        require_extra("render", *RENDERER, of="rendering")
        findings = check_laws(laws, options.out, quick=options.quick, show=_print)
        print(f"page: {write_page(list(LAWS.values()), findings, folder=options.out, quick=options.quick)}")
    except SafGenError as error:
        print(f"studies.laws: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("stopped; what was found is kept: the same command continues", file=sys.stderr)
        return 130
    return int(any(found.outcome in ("failed", "broken") for found in findings.values()))


def _print(law: Law, found: Finding) -> None:
    right = sum(one.passed for one in found.comparisons)
    said = f"{right} of {len(found.comparisons)} figures, {found.tolerance_used:.2f} of the tolerance used"
    print(f"{law.name:24} {found.outcome:8} {found.reason or said}", flush=True)
    for one in found.comparisons:
        if not one.passed:
            print(f"{'':33} {one.what}: {one.measured:.6g}, allowed {one.at_least:.6g} to {one.at_most:.6g}")
