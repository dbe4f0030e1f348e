"""The command `bodysense`: one function a subcommand; heavy imports wait until a command needs them."""

from __future__ import annotations

import errno
import sys
from collections.abc import Sequence

from bodysense import __version__
from bodysense.errors import BodysenseError, missing_package


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. Returns the exit status: a command's own, or 2 for what the user gave wrong."""
    try:  # from the first import on: it takes a while, in which Ctrl-C may come
        from bodysense.cli.application import application
        from bodysense.cli.overwriting import checked_arguments
        from bodysense.cli.packages import check_installed, lines_of_missing

        given = checked_arguments(sys.argv[1:] if arguments is None else arguments)
        if list(given) == ["--version"]:
            print(f"bodysense {__version__}")
            return 0
        check_installed(given)
        try:
            description = "\n\n".join([_description(), *lines_of_missing()])
            status = application().cli(prog="bodysense", description=description, args=given)
        except ModuleNotFoundError as error:
            raise missing_package(error) from None
    except BodysenseError as error:
        print("bodysense:", " ".join(str(error).splitlines()), file=sys.stderr)
        return 2
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        where = f" for {error.filename}" if error.filename else ""
        print(f"bodysense: the disk is full{where}; free some space and run the same command again", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("bodysense: stopped", file=sys.stderr)
        return 130
    return status or 0


def _description() -> str:
    return (
        f"Completes a human body, hands included, from partial tracking. Version {__version__} (--version). "
        "With any command, --overwrite lets an output take the place of an input."
    )


def entry_point() -> None:
    """What the installed script calls."""
    sys.exit(main())
