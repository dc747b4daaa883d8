"""The program: its commands together, and errors turned into exit codes."""

import io
import sys
from typing import Annotated

import typer
from rich.markup import escape

from impactscope.cli.blows import analyse, live, replay
from impactscope.cli.characterise import characterise
from impactscope.cli.console import err, out, print_nowhere
from impactscope.cli.demo import demo
from impactscope.cli.explain import explain
from impactscope.cli.files import conceal, convert, info, paper, simulate
from impactscope.cli.printing import UNREADABLE
from impactscope.errors import ConfigurationError, ImpactscopeError, RecordingError
from impactscope.version import __version__

__all__ = ['app', 'main']

READER_GONE = 141  # as of a program that a closed pipe ends

app = typer.Typer(
    name='impactscope',
    help=(
        'Live impact testing of collaborative robots: record the blow, identify the sensor, '
        'judge against contact limits.\n\n'
        'Start with [bold]impactscope demo[/bold], or analyse a recording: '
        '[bold]impactscope analyse bags/simulated_hand_pass.mcap --report report.html[/bold].\n\n'
        'Exit codes: 0 passed or done, 1 failed, 2 wrong usage, 3 unreadable recording, '
        '4 invalid, 5 incomplete. It measures and judges; it is not a safety function and never '
        'commands a robot.'
    ),
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode='rich',
    pretty_exceptions_enable=False,
)
for command in (analyse, replay, live, simulate, info, convert, paper, conceal, explain):
    app.command()(command)
app.add_typer(characterise, name='characterise')
app.command()(demo)


def _version(wanted: bool) -> None:
    if wanted:
        out.print(f'impactscope {__version__}')
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option('--version', callback=_version, is_eager=True, help='Say the version.')
    ] = False,
) -> None:
    """Options of every command."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # who reads a pipe sees each blow at once
    try:
        code = app(arguments, standalone_mode=False)
    except typer.Exit as stop:
        return int(stop.exit_code)
    except (typer.Abort, KeyboardInterrupt):
        return _interrupted()
    except BrokenPipeError:  # as older versions of rich say it
        print_nowhere()
        return READER_GONE
    except ConfigurationError as error:
        return _fail(error, 2)
    except RecordingError as error:
        return _fail(error, UNREADABLE)
    except ImpactscopeError as error:
        return _fail(error, 2)
    except Exception as error:
        usage = getattr(error, 'format_message', None)  # click's own errors of usage
        if usage is None and isinstance(error.__cause__, KeyboardInterrupt):
            return _interrupted()  # compiled code that was about to return says it like this
        if usage is None:
            raise
        error.show()  # type: ignore[attr-defined]
        return int(getattr(error, 'exit_code', 2))
    return code if isinstance(code, int) else 0


def _interrupted() -> int:
    err.print('interrupted')
    return 130


def _fail(error: Exception, code: int) -> int:
    err.print(f'[red]impactscope:[/red] {escape(str(error))}')
    return code
