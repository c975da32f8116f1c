"""The commands ``pack`` and ``fetch``."""

from pathlib import Path
from typing import Annotated

import typer

from saf_gen.cli._terminal import OutFolder, err, out, progress_bars


def pack_command(
    dataset: Annotated[Path, typer.Argument(help="Dataset folder.")],
    folder: Annotated[Path, typer.Option("--out", help="Folder for shards, index and cards; empty or new.")],
    *,
    shard_mb: Annotated[int, typer.Option(min=1, help="Size of a shard, in MB.")] = 1000,
    stacks: Annotated[
        bool, typer.Option("--stacks", help="Also pack focal stacks, which the closed loop needs.")
    ] = False,
    licence: Annotated[
        list[str] | None,
        typer.Option(help="SPDX name, such as CC-BY-4.0; repeatable (default: licences of the scenes)."),
    ] = None,
    url: Annotated[str, typer.Option(help="Address of the published dataset, for its card.")] = "",
    creator: Annotated[str, typer.Option(help="Creator of the dataset, for its card.")] = "",
) -> None:
    """Pack a dataset for publication, into tar shards with an index of digests."""
    from saf_gen.stream.sharing import pack_dataset

    with progress_bars() as bars:
        task = bars.add_task("pack", total=1.0)
        packed = pack_dataset(
            dataset,
            folder,
            shard_bytes=shard_mb * 1_000_000,
            stacks=stacks,
            licences=licence or (),
            url=url,
            creator=creator,
            report=lambda done, total: bars.update(task, completed=done, total=total),
        )
    index = packed.index
    out.print(f"{len(index.shards)} shards, {index.total_bytes / 1e6:,.1f} MB in {folder}", soft_wrap=True)
    out.print(f"sha256 of its index: {packed.index_sha256}", soft_wrap=True)
    out.print(f"next: saf-gen fetch {folder} --sha256 {packed.index_sha256}", soft_wrap=True)
    if packed.missing:
        err.print(f"its card has no {' and no '.join(packed.missing)}; add --{', --'.join(packed.missing)}")


def fetch_command(
    source: Annotated[str, typer.Argument(help="Address (http or https) or folder of a packed dataset.")],
    *,
    folder: OutFolder = None,
    sha256: Annotated[str, typer.Option(help="SHA-256 of the index, as stated by its publisher.")] = "",
) -> None:
    """Fetch a packed dataset, check every file and unpack it, or resume a fetch that was stopped."""
    from saf_gen.stream.manifest import read_manifest
    from saf_gen.stream.sharing import fetch_dataset

    with progress_bars() as bars:
        task = bars.add_task("fetch", total=1.0)
        target, index = fetch_dataset(
            source,
            folder,
            index_sha256=sha256,
            report=lambda done, total: bars.update(task, completed=done, total=total),
        )
    count = sum(len(shard.members) for shard in index.shards)
    out.print(f"{count} files, {index.total_bytes / 1e6:,.1f} MB, every digest correct")
    out.print(f"dataset: {target}   (next: {read_manifest(target).next_command(target)})", soft_wrap=True)
