"""Runs checks one after the other and saves the result of each, so that an interrupted run can be resumed."""

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
from saf_gen.core.files import check_writable, write_text
from saf_gen.errors import SafGenError

RESULTS = ".validation"
"""Folder for results and datasets, next to the page; it may be deleted."""

ReportCheck = Callable[[int, int, str], None]


def run_validation_checks(
    checks: Sequence[Check], folder: Path, *, quick: bool = False, report: ReportCheck = lambda done, total, what: None
) -> list[Verdict]:
    """Run checks and return their verdicts, in the same order.

    The verdict of a check that passed or failed is saved in ``folder`` at once. If the check is run there again, at the
    same size and with the same code of saf_gen, the saved verdict is returned. Datasets are deleted when all checks
    have ended, and kept if the run is interrupted.

    Parameters
    ----------
    checks : sequence of Check
        Checks to run, such as :func:`saf_gen.acceptance.validation.choose_validation_checks` returns.
    folder : Path
        Folder of the page; results and datasets are saved in its subfolder ``.validation``.
    quick : bool, default False
        Whether to run the small sizes.
    report : callable, optional
        Called with the number of checks done, the number of all checks, and the name and stage of the current one.

    Returns
    -------
    list of Verdict

    Raises
    ------
    BadInput
        If the folder cannot be written.
    """
    check_writable(folder)
    home = folder / RESULTS / f"{fingerprint_validated_source()[:12]}-{'quick' if quick else 'whole'}"
    if (folder / RESULTS).is_dir():  # results and datasets of other code are of no use
        for other in (folder / RESULTS).iterdir():
            if other.name.partition("-")[0] != home.name.partition("-")[0]:
                shutil.rmtree(other, ignore_errors=True)
    verdicts, maker = [], DatasetMaker(home / "datasets")
    for done, check in enumerate(checks):

        def notify(stage: str, check: Check = check, done: int = done) -> None:
            report(done, len(checks), f"{check.name}: {stage}")

        notify("starts")
        file = home / f"{check.name}.json"
        if file.is_file():
            verdicts.append(Verdict.from_dict(json.loads(file.read_text(encoding="utf-8"))))
            continue
        verdict = _run_check(check, replace(maker, report=notify), quick=quick)
        if verdict.outcome in ("passed", "failed"):
            text = json.dumps(verdict.as_dict(), ensure_ascii=False, allow_nan=False)
            write_text(file, text)
        verdicts.append(verdict)
    report(len(checks), len(checks), "done")
    maker.clear()
    return verdicts


def _run_check(check: Check, maker: DatasetMaker, *, quick: bool) -> Verdict:
    """Run one check; an error of saf_gen gives the verdict ``broken`` with the error's message, and is not raised."""
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
    """Return the SHA-256 (hex) of all code and presets of saf_gen, which identifies results of other code."""
    package = Path(saf_gen.__file__).resolve().parent
    digest = hashlib.sha256()
    for path in sorted(p for p in package.rglob("*") if p.suffix in (".py", ".yaml")):
        digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()
