"""Examples at the end of the help of each command; every command has at least one, and a test parses them all."""

from collections.abc import Mapping

EXAMPLES: dict[str, tuple[str, ...]] = {
    "": ("generate quickstart", "evaluate datasets/quickstart", "scenes list", "methods show sd"),
    "generate": (
        "generate quickstart",
        "generate recipes/sad_synthetic.yaml --dry-run --machines 8",
        "generate my_recipe.yaml --out datasets/mine --workers 2",
        "generate quickstart --shard 2/3",
    ),
    "evaluate": (
        "evaluate datasets/quickstart",
        "evaluate recording.h5 --method sd_code+sgfs_code:dt=50 --out judged",
        "evaluate datasets/quickstart --track closed_loop --budget 100",
        "evaluate datasets/quickstart --predictions answers.jsonl",
    ),
    "leaderboard": ("leaderboard mine/evaluation other/evaluation --out merged", "leaderboard verify mine/evaluation"),
    "leaderboard merge": ("leaderboard merge mine/evaluation other/evaluation --out merged",),
    "leaderboard verify": (
        "leaderboard verify datasets/quickstart/evaluation",
        "leaderboard verify theirs --on mine --method their.py:Measure+argmax",
    ),
    "tune": ("tune mine --method sd+sgfs_code --try search.dt=25,50 --out best.json",),
    "score": ("score recording.h5 --measure sd --window 100 --out curve.csv",),
    "import": (
        "import camera.dat --layout dense --out recording.h5 --focus lens.csv",
        "import spikes.mat --axes YXT --out recording.h5 --key spk --rate 40000",
        "import camera.raw --out recording.h5 --size 600x400 --bits msb",
    ),
    "encode": (
        "encode frames --out recording.h5 --rate 1000",
        "encode frames.npy --out recording.h5 --rate 640 --linear --truth 0.42",
    ),
    "export": ("export recording.h5 --out frames.dat --for spikecv",),
    "cut": (
        "cut recording.h5 --from 2000 --to 12000 --out part.h5",
        "cut recording.h5 --rows 50:200 --columns :300 --out part.h5",
    ),
    "recapture": (
        "recapture datasets/quickstart --sensor davis346",
        "recapture datasets/quickstart --sensor swissspad3 --out elsewhere",
    ),
    "inspect": ("inspect recording.h5", "inspect recording.h5 --json"),
    "view": (
        "view recording.h5 --out sweep.png --measure sd",
        "view recording.h5 --out sweep.html --as tfi --window 200",
    ),
    "verify": ("verify datasets/quickstart",),
    "fetch": ("fetch https://example.org/quickstart",),
    "init": ("init", "init my_project", "init my_project --forget"),
    "doctor": ("doctor", "doctor --json"),
    "scenes list": ("scenes list", "scenes list --json"),
    "scenes show": ("scenes show camel",),
    "scenes new": ("scenes new my_scene", "scenes new my_scene --from exported/scene.xml"),
    "scenes check": ("scenes check my_scene", "scenes check camel fan --json"),
    "scenes preview": ("scenes preview my_scene --out sheet.png", "scenes preview camel fan --out sheets"),
    "dataset index": ("dataset index recordings",),
    "dataset merge": ("dataset merge quickstart shard1 shard2 --out datasets/quickstart",),
    "recipes list": ("recipes list",),
    "recipes check": ("recipes check my_recipe.yaml",),
    "sensors list": ("sensors list",),
    "sensors show": ("sensors show vidar_400x250",),
    "sensors check": ("sensors check my_camera.yaml",),
    "lens fit": (
        "lens fit double_gauss.zmx --height-mm 12",
        "lens fit design.json --out my.yaml --glass BAF7=1.608/46.2",
    ),
    "lens show": ("lens show double_gauss", "lens show my_lens.yaml --out my_lens.png"),
    "methods": ("methods", "methods --json"),
    "methods show": ("methods show sd", "methods show sd_code+sgfs_code:dt=50"),
    "methods check": ("methods check sd+argmax",),
}
"""Examples by command, without the word saf-gen; "" is the program itself. Add-ons bring their own."""


def help_ending(command: str, examples: Mapping[str, tuple[str, ...]]) -> str:
    """Return the end of a help text: the examples of a command, or of a group and the first of each of its commands."""
    lines = list(examples.get(command, ()))
    lines += [under[0] for name, under in examples.items() if command and name.startswith(f"{command} ")]
    return "\n".join(["Examples:", *(f"  saf-gen {line}" for line in lines)])
