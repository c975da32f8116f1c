"""Calls of code that users bring along: plug-ins, scripts of scenes, policies.

Such code may raise anything. ``exit``, which also ``argparse`` calls, raises SystemExit, which is not an Exception: it
would end the whole run, and the results of other methods and scenes would be lost.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from saf_gen.errors import BadInput, SafGenError


class CodeStopped(Exception):
    """Error in place of an exception of users' code that is not an Exception, such as SystemExit."""


class PassesUserCode(BaseException):
    """Base class of the exceptions that saf_gen raises through users' code, and that :func:`user_code` leaves alone."""


def describe_exit(error: SystemExit) -> str:
    """Return the call that raised SystemExit, such as "exit(2)"."""
    return f"exit({'' if error.code is None else repr(error.code)})"


@contextmanager
def user_code() -> Iterator[None]:
    """Run users' code in the ``with`` block, so that whatever it raises, but Ctrl-C, is an Exception.

    A copy of this process that the code has made by ``fork`` ends at the end of the block: it must not go on with our
    work.

    Raises
    ------
    CodeStopped
        If the code calls ``exit``, or raises another BaseException than KeyboardInterrupt. Every Exception of the code
        is left as it is.
    """
    owner = os.getpid()
    try:
        yield
    except (Exception, KeyboardInterrupt, PassesUserCode):
        raise
    except SystemExit as error:
        raise CodeStopped(f"its code called {describe_exit(error)}").with_traceback(error.__traceback__) from error
    except BaseException as error:
        message = f"its code raised {type(error).__name__}: {error}"
        raise CodeStopped(message).with_traceback(error.__traceback__) from error
    finally:
        if os.getpid() != owner:
            os._exit(1)


@contextmanager
def named_user_code(plug_in: object, kind: str = "") -> Iterator[None]:
    """Run users' code in the ``with`` block, so that an error names it, as "focus measure 'mine'".

    Parameters
    ----------
    plug_in : object
        Plug-in or its name, of which the error states the ``repr``.
    kind : str, optional
        Kind of the plug-in, in words.

    Raises
    ------
    BadInput
        If the code calls ``exit`` or raises anything but SafGenError, MemoryError and KeyboardInterrupt.
    """
    try:
        with user_code():
            yield
    except (SafGenError, MemoryError):
        raise
    except Exception as error:  # users' code may raise anything
        problem = f"{kind} {plug_in!r} fails: {type(error).__name__}: {error}"
        raise BadInput(problem.lstrip(), hint="repair it") from error
