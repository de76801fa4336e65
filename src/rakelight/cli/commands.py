"""The commands: one thin file each, loaded when it is called; and what a failure says."""

from __future__ import annotations

import atexit
import gc
import os
import traceback
from collections.abc import Callable
from importlib import import_module
from typing import Any

import click

from rakelight.cli import INTERRUPTED
from rakelight.errors import RakelightError, causes, machine_fault, printable
from rakelight.memory import keep_freed_memory, require_addresses

# Command -> what it does; `rakelight --help` shows them in this order.
COMMANDS = {
    "demo": "make a synthetic capture, refine it, compare it with its truth",
    "refine": "refine the depth of a capture: a folder or a recording",
    "batch": "refine many captures, on this machine or on a Dask cluster",
    "import": "make a capture folder of a recording or another format",
    "check": "say whether a capture is any good, and what to do better",
    "view": "open the report of a result in the browser",
    "synth": "make a capture with known truth",
    "eval": "compare a result with the truth of a synthetic capture",
    "paper": "the paper's tables and figures on our captures",
}
# Those that compile kernels, whatever they are given.
COMPILE = {"demo", "refine", "batch", "check", "synth", "paper"}
# Bytes of addresses that the libraries and their threads take without the compiler: `eval` ends
# well from 0.33e9 on, `import` from 0.55e9 (x86-64, two cores).
LIBRARIES_BYTES = 0.55e9


class LazyGroup(click.Group):
    """Commands whose modules are imported only when they are needed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The commands, the most used first."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """The command `name`, from the module of that name."""
        if name not in COMMANDS:
            return None
        _require_addresses(name)
        file = "import_" if name == "import" else name  # a word of Python is no name of a module
        module = import_module(f"rakelight.cli.{file}")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of commands, without importing any of them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


def _require_addresses(name: str) -> None:
    """Refuse, before any library is loaded, a process that would run out of addresses in one.

    There it would print lines that are not ours, fail with an error that says nothing, or leave a
    thread waiting for ever.
    """
    from rakelight.jit import compiler_addresses

    compiler = compiler_addresses() if name in COMPILE else 0.0
    require_addresses(LIBRARIES_BYTES + compiler, source=f"rakelight {name}")


def _show_version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted:
        from rakelight import __version__

        click.echo(f"rakelight {__version__}")
        ctx.exit()


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=_show_version,
    help="Show the version and exit.",
)  # fmt: skip
def rakelight() -> None:
    """Depth maps of RGB-D cameras refined by photographs under moving light."""


def run(arguments: list[str], interrupted: Callable[[], bool] = lambda: False) -> int:
    """Run the command and return its exit code; a failure is one line on stderr.

    interrupted : whether a signal has come.  Raises KeyboardInterrupt where the command failed
        after one: a library may have lost the signal, and failed by it
    """
    # Threads that wait sleep: a machine busy with other work would else stand still with us.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    # Our dense systems are small; BLAS threads would only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # What is left goes with the process: the last search for cycles would take a quarter second.
    atexit.register(gc.freeze)
    # Libraries come with more objects than that, and no cycles worth the search.
    gc.set_threshold(100_000)
    keep_freed_memory()
    return _run(arguments, interrupted)


def _run(arguments: list[str], interrupted: Callable[[], bool]) -> int:
    debug = "--debug" in arguments
    try:
        code: Any = rakelight.main(arguments, prog_name="rakelight", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        return 2
    except click.ClickException as error:
        message = " ".join(error.format_message().split()).rstrip(".")
        return _fail(message + _where_to_look(error), 2, debug)
    except (KeyboardInterrupt, click.Abort) as error:
        cause = error.__cause__  # click makes an Abort of any EOFError
        if isinstance(cause, EOFError) and not interrupted():
            return _unexpected(cause, debug)
        return _interrupted(debug)
    except SystemExit:  # click's answer when the reader of our output has gone, as after `| head`
        return 0
    except Exception as error:
        if interrupted():
            raise KeyboardInterrupt from error
        if isinstance(error, RakelightError):
            return _fail(str(error), error.exit_code, debug)
        return _unexpected(error, debug)
    return code if isinstance(code, int) else 0


def _unexpected(error: Exception, debug: bool) -> int:
    """What none of us raised: the machine's fault, where a library says so in its own words."""
    if any(isinstance(cause, KeyboardInterrupt) for cause in causes(error)):
        return _interrupted(debug)  # a library made another error of it
    if (line := machine_fault(error, _MORE_MEMORY)) is not None:
        return _fail(line, 3, debug)
    what = f"a bug in rakelight: {type(error).__name__}: {error}"
    return _fail(f"{what}. Fix: run it again with --debug and report all it prints", 1, debug)


_MORE_MEMORY = "close other programs, use --scale 1, or raise the limit (`ulimit -v`)"


def _interrupted(debug: bool) -> int:
    return _fail(INTERRUPTED, 130, debug)


def _where_to_look(error: click.ClickException) -> str:
    if isinstance(error, click.UsageError) and error.ctx is not None:
        return f" (see {error.ctx.command_path} --help)"
    return ""


def _fail(message: str, code: int, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    click.echo(f"error: {printable(message)}", err=True)
    return code
