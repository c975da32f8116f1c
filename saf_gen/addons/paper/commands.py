"""The command ``paper``."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._tables import print_table
from saf_gen.cli._terminal import OutFolder, out, progress_bars, terminal_reporter
from saf_gen.cli.command import FINISHED_WORK_IS_KEPT, Command, Panel


def paper_command(
    dataset: Annotated[Path, typer.Argument(help="Dataset folder or its name, such as paper_small.")],
    *,
    folder: OutFolder = None,
) -> None:
    """Draw the figures of the paper from a dataset, and judge its claims.

    The dataset needs static and dynamic scenes under constant, continuous and sudden light. Without --out, the files go
    to the folder paper in it.
    """
    from saf_gen.addons.paper.conditions import run_methods, select_sequences
    from saf_gen.stream.sample_dataset import find_data

    dataset = find_data(dataset)
    tasks = select_sequences(dataset)

    from saf_gen.addons.paper.claims import judge_claims
    from saf_gen.addons.paper.figures import draw_figures
    from saf_gen.addons.paper.page import check_replaceable, write_paper
    from saf_gen.benchmark.kept_sequences import KeptSequences, kept_folder
    from saf_gen.core.files import check_writable, lock_folder

    target = folder or dataset / "paper"
    check_replaceable(target)
    check_writable(target)
    kept = KeptSequences(kept_folder(target))
    with lock_folder(target):
        with progress_bars() as bars:
            report = terminal_reporter("paper", bars, parts=len(tasks))
            run = run_methods(tasks, keep=kept, stacks=dataset / "stacks", progress=report)
        claims = judge_claims(run)
        title = f"The paper's figures and claims on {dataset.resolve().name}"
        written = write_paper(target, run, figures=draw_figures(run), claims=claims, title=title)
        kept.remove()
    print_table(claims, where_to_find="the page shows them")
    for path in written:
        out.print(str(path), soft_wrap=True)


COMMANDS = {
    "paper": Command(
        paper_command,
        examples=("paper datasets/paper_small", "paper datasets/paper_small --out figures"),
        panel=Panel.GENERATE,
        stopped=FINISHED_WORK_IS_KEPT,
    )
}
