"""The command ``live``."""

import os
import signal
import sys
import threading
import webbrowser
from typing import Annotated

import typer
from rich.progress import TaskID

from saf_gen.cli._terminal import err, out, progress_bars
from saf_gen.cli.command import FINISHED_WORK_IS_KEPT, Command, Panel


def live_command(
    scene: Annotated[
        str, typer.Argument(help="sample, a scene, a dataset folder with its stacks, or one of its streams.")
    ],
    *,
    region: Annotated[str, typer.Option(help="Pixels that are read out: target or frame.")] = "target",
    actuator: Annotated[str, typer.Option(help="Drive of the lens: a name or a .yaml file.")] = "voice_coil",
    sensor: Annotated[str, typer.Option(help="Sensor in front of a scene: a name or a .yaml file.")] = "vidar_400x250",
    samples: Annotated[int, typer.Option(min=1, help="Light paths per pixel and position of a scene's stack.")] = 64,
    seed: Annotated[int | None, typer.Option(help="Seed of noise and lens (default: that of the recording).")] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0: a free one.")] = 0,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address and open no browser.")] = False,
) -> None:
    """Hold a running camera, and focus it on a page.

    The page turns focus and lamps, and shows counts, scores and what methods do.
    """
    from saf_gen.addons.live.camera import LiveCamera
    from saf_gen.addons.live.server import LiveRoom, LiveServer
    from saf_gen.addons.live.source import open_capture

    with progress_bars() as bars:
        tasks: dict[str, TaskID] = {}

        def report(name: str, done: float) -> None:
            if name not in tasks:
                tasks[name] = bars.add_task(name, total=1.0)
            bars.update(tasks[name], completed=done)

        capture = open_capture(scene, sensor=sensor, samples=samples, report=report, tell=err.print)
    room = LiveRoom(LiveCamera(capture, region=region, actuator=actuator, seed=seed))
    with LiveServer(room, port) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        out.print(f"{server.address}   (Ctrl-C ends it)", soft_wrap=True)
        if not no_browser and _has_screen():
            webbrowser.open(server.address)
        try:
            _stay()
        finally:
            room.stop_method()
            server.shutdown()


def _stay() -> None:
    """Wait for Ctrl-C, which is the usual end; SIGTERM ends this command as every other."""
    stopped = threading.Event()
    before = signal.signal(signal.SIGINT, lambda *_: stopped.set())
    while not stopped.wait(0.5):  # on Windows, a signal is not handled while a thread waits for ever
        pass
    signal.signal(signal.SIGINT, before)


def _has_screen() -> bool:
    """Return whether a browser can open a window, and not take over the terminal."""
    names = ("DISPLAY", "WAYLAND_DISPLAY")
    return sys.platform in ("win32", "darwin") or any(map(os.environ.get, names))


COMMANDS = {
    "live": Command(
        live_command,
        examples=("live sample", "live usaf_target", "live datasets/quickstart --no-browser --port 8000"),
        panel=Panel.EVALUATE,
        stopped=FINISHED_WORK_IS_KEPT,
    )
}
