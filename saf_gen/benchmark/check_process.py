"""The process in which plug-ins of others are described and checked; see :mod:`saf_gen.benchmark.checking`.

``python -m saf_gen.benchmark.check_process DESCRIPTOR PATH SECONDS`` is started as a guest is, by
:class:`saf_gen.benchmark.guests.host.GuestProcess`.
"""

import os
import sys
from dataclasses import asdict
from typing import Any

from saf_gen.benchmark.conformance import check_parts, find_parts
from saf_gen.benchmark.guests.process import open_line, refusal
from saf_gen.benchmark.plugin_description import describe_plugin
from saf_gen.benchmark.search_run import describe_exception
from saf_gen.core.user_code import user_code
from saf_gen.errors import BadInput


def main() -> None:
    """Send descriptions of plug-ins, run the checks of ``saf-gen methods check`` on them, send each result, and end."""
    line = open_line()
    order, parts = line.receive_order(), dict[str, Any]()
    try:
        with user_code():
            parts = find_parts(order["halves"], order["kind"])
            described = [
                describe_plugin(half[0], kind, plug_in=parts[kind])
                for half, kind in zip(order["halves"], parts, strict=True)
            ]
            hello: dict[str, Any] = {"plugins": [asdict(one) for one in described]}
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


if __name__ == "__main__":
    main()
