"""The command `bodysense`: one function for each subcommand. Heavy modules are imported only when a command runs."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Sequence

from bodysense import __version__
from bodysense.errors import BodysenseError, missing_package

# Commands whose products of matrices are small: threads of NumPy's BLAS would wait for each other longer than they
# work, above all next to other programs, and each of --jobs would have its own.
_SMALL_PRODUCTS = ("check", "convert", "demo", "repair", "track")

_DESCRIPTION = (
    f"Completes a human body, hands included, from partial tracking. Version {__version__} (--version). With any "
    "command, --overwrite lets an output take the place of an input, and --quiet prints warnings and errors only."
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. Returns the exit status: a command's own, or 2 for an error of the user's input."""
    try:  # imports take some time, during which the user may press Ctrl-C
        from bodysense.cli.application import application
        from bodysense.cli.overwriting import check_arguments
        from bodysense.cli.packages import check_installed, installed, lines_of_missing, needed
        from bodysense.cli.parsing import run
        from bodysense.cli.quiet import QUIET, quietly

        given = check_arguments(sys.argv[1:] if arguments is None else arguments)
        if list(given) == ["--version"]:
            print(f"bodysense {__version__}")
            return 0
        found = installed()
        words = [word for word in given if word != QUIET]
        check_installed(found, words)
        description = "\n\n".join([_DESCRIPTION, *lines_of_missing(found)])
        with quietly(QUIET in given):
            try:
                status = run(application(needed(found, words)), description, words)
            except ModuleNotFoundError as error:
                raise missing_package(error) from None
    except BodysenseError as error:
        print("bodysense:", " ".join(str(error).splitlines()), file=sys.stderr)
        return 2
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    except OSError as error:
        print("bodysense:", _line_of(error), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("bodysense: stopped", file=sys.stderr)
        return 130
    return status or 0


def _line_of(error: OSError) -> str:
    """Return a message about a failed file or device."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        where = f" for {error.filename}" if error.filename else ""
        return f"the disk is full{where}; free some space and run the same command again"
    where = f"{error.filename}: " if error.filename else ""
    return f"{where}{error.strerror or error}; check the path and its permissions, and run the same command again"


def entry_point() -> None:
    """Run the command line as the installed script does."""
    command = next((word for word in sys.argv[1:] if not word.startswith("-")), None)
    if command in _SMALL_PRODUCTS:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # is read when NumPy is imported
    sys.exit(main())
