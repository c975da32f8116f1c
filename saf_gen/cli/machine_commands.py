"""The command ``doctor``."""

import typer

import saf_gen
from saf_gen.cli._tables import print_facts, print_json
from saf_gen.cli._terminal import AsJson, out
from saf_gen.cli.command import Command, Panel


def doctor_command(*, as_json: AsJson = False) -> None:
    """Show this machine, and check that it computes correctly.

    Its renderer, hardware and versions are shown; the check takes some seconds.

    The blur of an edge and the intervals of spikes are compared with their laws, and spikes with those of other
    machines. The exit code is 1 if one of them differs.
    """
    from saf_gen.cli.doctor import describe_machine, self_check

    described, advice = describe_machine()
    if not as_json:
        print_facts(described, title=f"saf-gen {saf_gen.__version__}")
        for line in advice:
            out.print(line)
    checked = {name: f"{'ok' if passed else 'failed'}: {said}" for name, (passed, said) in self_check().items()}
    if as_json:
        print_json(described | checked)
    else:
        for name, text in checked.items():
            out.print(f"{text.partition(': ')[0]}: {name}: {text.partition(': ')[2]}", soft_wrap=True)
    if any(text.startswith("failed") for text in checked.values()):
        raise typer.Exit(1)


COMMANDS = {"doctor": Command(doctor_command, ("doctor", "doctor --json"), Panel.SHARE)}
"""The commands of this file, by the words that call them."""
