"""The connection to a Dask scheduler, and what is wrong if there is none: in one line, and within half a minute.

Anything may listen at an address. Dask's client waits for ever for a port that says nothing, takes memory for whatever
another protocol says, and needs 20 s to end. So one question is asked before a client is made.
"""

import asyncio
import logging
import socket
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from saf_gen.errors import BadInput, closest

CONNECT_S = 10.0
"""Time in which a scheduler must answer; one that starts at the same time is waited for."""
LOOK_S = 3.0
SCHEDULER_PACKAGES = ("dask", "distributed", "msgpack")
ALLOWED = "an address such as tcp://host:8786, or tls://host:8786 with certificates in Dask's configuration"
NEXT_STEP = "start one with `dask scheduler`, and give the address that it prints"


@contextmanager
def silence_dask() -> Iterator[None]:
    """Keep Dask's log of a lost connection off the terminal, because a one-line error reports it."""
    import distributed

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", distributed.versions.VersionMismatchWarning)  # connect checks versions
        quiet = [
            logger
            for name, logger in logging.root.manager.loggerDict.items()
            if isinstance(logger, logging.Logger) and name.split(".")[0] in ("distributed", "tornado", "asyncio")
        ]
        disabled = {logger: logger.disabled for logger in quiet}
        for logger in quiet:
            logger.disabled = True
        try:
            yield
        finally:
            for logger, was in disabled.items():
                logger.disabled = was


@contextmanager
def connect(address: str) -> Iterator[Any]:
    """Yield a client of the scheduler, after checking that its versions of Dask and Python match those here.

    Raises
    ------
    BadInput
        If no scheduler answers at the address, or if it has another version of Dask.
    """
    import distributed

    _check_address(address)
    _check_versions(address, _ask_scheduler(address))
    try:
        client = distributed.Client(address, timeout=f"{CONNECT_S}s", set_as_default=False)
    except Exception as error:  # it has gone since it was asked
        raise _no_scheduler(address, str(error)) from error
    try:
        yield client
    finally:
        client.close(timeout=2)


def list_workers(client: Any) -> dict[str, Any]:
    """Return what the scheduler knows of each worker, by address.

    The scheduler is asked itself, because ``Client.scheduler_info`` returns a field of the client that a timer of the
    client replaces by one without workers: at any time, so also just before it is returned.
    """
    return dict(client.sync(client.scheduler.identity, n_workers=-1)["workers"])


def within(seconds: float, function: Callable[[], Any]) -> Any:
    """Return the result of a function that may never return; raise TimeoutError after a time."""
    found: list[Any] = []
    raised: list[BaseException] = []

    def run() -> None:
        try:
            found.append(function())
        except BaseException as error:  # noqa: BLE001  (raised again by the caller)
            raised.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(seconds)
    if raised:
        raise raised[0]
    if not found:
        raise TimeoutError
    return found[0]


def _no_scheduler(address: str, why: str) -> BadInput:
    return BadInput(f"no Dask scheduler answers at {address!r}: {why}", allowed=ALLOWED, hint=NEXT_STEP)


def _check_address(address: str) -> None:
    """Raise BadInput if this cannot be the address of a scheduler."""
    from distributed import Security
    from distributed.comm.addressing import parse_address, parse_host_port
    from distributed.comm.registry import backends

    try:
        scheme, place = parse_address(address)
        if scheme not in backends:
            raise BadInput(
                f"no Dask scheduler answers at {address!r}: {scheme!r} is no protocol of Dask",
                allowed=ALLOWED,
                nearest=closest(scheme, ("tcp", "tls")),
            )
        if scheme != "inproc":
            host, port = parse_host_port(place)
            if not (host and 0 < port < 1 << 16):
                raise ValueError("it needs a host, and a port from 1 to 65535")
        if scheme == "tls" and not Security().get_connection_args("client")["ssl_context"]:
            raise ValueError("no certificates are set")
    except (ValueError, TypeError, ImportError, OSError) as error:
        raise _no_scheduler(address, str(error)) from error


def _ask_scheduler(address: str) -> dict[str, Any]:
    """Return the versions of the scheduler's packages; raise BadInput if no scheduler answers in time."""
    try:
        found, kind = within(CONNECT_S + LOOK_S, lambda: asyncio.run(_ask(address)))
    except Exception as error:  # Dask raises anything, MemoryError too, over what another protocol says
        raise _no_scheduler(address, _look(address) or f"{type(error).__name__}: {error}") from error
    if kind != "Scheduler":
        raise _no_scheduler(address, f"it is the address of a {kind.lower()}")
    packages: dict[str, Any] = found["packages"]
    return packages


async def _ask(address: str) -> tuple[dict[str, Any], str]:
    from distributed import Security, rpc

    arguments = Security().get_connection_args("client")
    async with asyncio.timeout(CONNECT_S), rpc(address, timeout=CONNECT_S, connection_args=arguments) as server:
        identity = await server.identity()
        return await server.versions(packages=list(SCHEDULER_PACKAGES)), str(identity["type"])


def _look(address: str) -> str:
    """Return in words what is at an address that is not a scheduler's, or '' if that cannot be seen."""
    from distributed.comm.addressing import parse_address, parse_host_port

    scheme, place = parse_address(address)
    if scheme == "inproc":
        return ""
    host, port = parse_host_port(place)
    try:
        with within(2 * LOOK_S, lambda: socket.create_connection((host, port), timeout=LOOK_S)) as there:
            with suppress(OSError):
                there.settimeout(LOOK_S)
                there.sendall(b"HEAD / HTTP/1.0\r\n\r\n")
                said = there.recv(64)
                if said.startswith(b"HTTP/"):
                    return "a web server listens there, perhaps the dashboard: a scheduler's port is 8786 by default"
                if said and scheme == "tcp":
                    return "something else listens there, which does not speak Dask's protocol"
            return "something listens there, but says nothing that a scheduler would say"
    except socket.gaierror as error:
        return f"the host {host!r} is unknown ({error.strerror})"
    except ConnectionRefusedError:
        return f"nothing listens on port {port} of {host}"
    except TimeoutError:
        return f"{host} does not answer (another network, or a firewall?)"
    except OSError as error:
        return f"{host} cannot be reached: {error.strerror or error}"


def _check_versions(address: str, theirs: dict[str, Any]) -> None:
    from distributed.versions import get_versions

    here: dict[str, Any] = get_versions(packages=list(SCHEDULER_PACKAGES))["packages"]
    other = [f"{name} {theirs[name]}, not {here[name]}" for name in SCHEDULER_PACKAGES if theirs[name] != here[name]]
    if str(theirs["python"]).split(".")[:2] != str(here["python"]).split(".")[:2]:
        other.append("another version of Python")
    if other:
        raise BadInput(
            f"the scheduler at {address} has {'; '.join(other)}",
            hint="install the versions in constraints.txt on all machines",
        )
