"""The process in which plug-ins of others are described and checked; see :mod:`saf_gen.benchmark.checking`."""

import os
import sys
from dataclasses import asdict
from typing import Any, NoReturn

from saf_gen.benchmark.conformance import check_parts, find_parts
from saf_gen.benchmark.guests.process import GuestLine, refusal
from saf_gen.benchmark.plugin_description import describe_plugin
from saf_gen.benchmark.search_run import describe_exception
from saf_gen.core.user_code import user_code
from saf_gen.errors import BadInput


def serve() -> NoReturn:
    """Send descriptions of plug-ins, run the checks of ``saf-gen methods check`` on them, send each result, and end."""
    line, parts = GuestLine(), dict[str, Any]()
    line.send({"files": []})
    halves, kind = line.order["halves"], line.order["kind"]
    try:
        with user_code():
            parts = find_parts(halves, kind)
            described = [
                describe_plugin(half[0], kind, plug_in=parts[kind]) for half, kind in zip(halves, parts, strict=True)
            ]
            hello: dict[str, Any] = {"plugins": [asdict(description) for description in described]}
    except BadInput as error:
        hello = refusal(error)
    except Exception as error:  # noqa: BLE001  code of others may raise anything
        hello = {"broken": describe_exception(error)}
    line.send(hello)
    line.receive()  # the evaluator may end this process here
    for finding in check_parts(parts):
        line.send({"finding": asdict(finding)})
    sys.stdout.flush()  # what the plug-ins printed
    line.send({"end": 1})
    os._exit(0)
