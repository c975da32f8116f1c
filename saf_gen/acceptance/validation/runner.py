"""Runs checks one after the other and keeps what each found, so that a run that was stopped goes on."""

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import saf_gen
from saf_gen.acceptance.validation.check import Check, CheckSkipped, Verdict
from saf_gen.acceptance.validation.workload import DatasetMaker
from saf_gen.core.files import check_folder_writable, write_text_atomically
from saf_gen.errors import SafGenError

KEPT = ".validation"
"""The folder, beside the page, of what was found and of datasets; it may be deleted."""

ReportCheck = Callable[[int, int, str], None]


def run_validation_checks(
    checks: Sequence[Check], folder: Path, *, quick: bool = False, report: ReportCheck = lambda done, total, what: None
) -> list[Verdict]:
    """Run checks and return how each ended, in their order.

    What a check found is written to ``folder`` at once. A check that was run there before, at the same size and with
    the same code of saf_gen, is not run again. Datasets are deleted when all checks have ended, and stay where the
    run is stopped.

    Parameters
    ----------
    checks : what :func:`saf_gen.acceptance.validation.choose_validation_checks` returns.
    folder : where the page will be; what is kept lies in it, in a folder ``.validation``.
    quick : run the small sizes.
    report : is called with checks that are done, their number, and what is at work.

    Raises
    ------
    BadInput : a folder that cannot be written.
    """
    check_folder_writable(folder)
    home = folder / KEPT / f"{fingerprint_validated_source()[:12]}-{'quick' if quick else 'whole'}"
    if (folder / KEPT).is_dir():  # what older code found, or left behind, is of no use
        for other in (folder / KEPT).iterdir():
            if other.name.partition("-")[0] != home.name.partition("-")[0]:
                shutil.rmtree(other, ignore_errors=True)
    verdicts, maker = [], DatasetMaker(home / "datasets")
    for done, check in enumerate(checks):

        def tell(stage: str, check: Check = check, done: int = done) -> None:
            report(done, len(checks), f"{check.name}: {stage}")

        tell("starts")
        file = home / f"{check.name}.json"
        if file.is_file():
            verdicts.append(Verdict.from_dict(json.loads(file.read_text(encoding="utf-8"))))
            continue
        verdict = _run_check(check, replace(maker, report=tell), quick=quick)
        if verdict.outcome in ("passed", "failed"):
            text = json.dumps(verdict.as_dict(), ensure_ascii=False, allow_nan=False)
            write_text_atomically(file, text)
        verdicts.append(verdict)
    report(len(checks), len(checks), "done")
    maker.clear()
    return verdicts


def _run_check(check: Check, maker: DatasetMaker, *, quick: bool) -> Verdict:
    """Run one check. An error of the product ends it as ``broken``, with the error's line; the others go on."""
    begin = perf_counter()
    try:
        found = check.run(maker, quick)
    except CheckSkipped as reason:
        return Verdict(check.name, "skipped", perf_counter() - begin, reason=str(reason))
    except SafGenError as error:
        return Verdict(check.name, "broken", perf_counter() - begin, reason=str(error))
    passed = bool(found.comparisons) and all(one.passed for one in found.comparisons)
    return Verdict(
        check.name,
        "passed" if passed else "failed",
        perf_counter() - begin,
        found.comparisons,
        found.plot,
        found.remarks,
    )


def fingerprint_validated_source() -> str:
    """Return the SHA-256 (hex) over all code and presets of saf_gen: what other code found is not used."""
    package = Path(saf_gen.__file__).resolve().parent
    digest = hashlib.sha256()
    for path in sorted(p for p in package.rglob("*") if p.suffix in (".py", ".yaml")):
        digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()
