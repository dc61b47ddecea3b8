"""Calls the installed command, which builds."""

from __future__ import annotations

import os
import shutil
import subprocess
from typing import Any

from ._chpm import File
from ._errors import CommandError

MISSING = (
    "the command '{}' is not on PATH, and this package only reads: install it with "
    "`cargo install --locked --path .` in the project's folder, or give command='/path/to/chpm'"
)


def build(
    source: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    command: str | os.PathLike[str] = "chpm",
    **options: Any,
) -> File:
    """Builds a ``.chpm`` file of a mesh, by the installed command ``chpm build``.

    Parameters
    ----------
    source : str or os.PathLike
        A mesh: PLY, STL, OBJ or a ``.conf`` set.
    output : str or os.PathLike
        The file to make. It is complete or not there.
    command : str or os.PathLike
        The command, if it is not on PATH or has another name.
    **options
        Options of ``chpm build`` without their dashes, ``_`` for ``-``: ``force=True``, ``memory="4G"``, ``pages="packed"``. True gives
        an option without a value; False and None leave it out. A list repeats it.

    Returns
    -------
    File
        The file, open.

    Raises
    ------
    CommandError
        If the command is not there, or fails: with what it said.
    """
    found = shutil.which(os.fspath(command))
    if found is None:
        raise CommandError(MISSING.format(os.fspath(command)))
    # Names that begin with a dash are no options.
    words = [found, "build", "--quiet", *_words(options), "--output", os.fspath(output), "--", os.fspath(source)]
    with subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as running:
        try:
            _, told = running.communicate()
        except KeyboardInterrupt:
            # The command has had the signal, too, if it came from the terminal; it says how to go on, and ends.
            running.terminate()
            running.wait()
            raise
    if running.returncode != 0:
        text = told.decode(errors="replace").strip().removeprefix("error: ")
        raise CommandError(text or f"'{found}' ended with {running.returncode}", running.returncode)
    return File(output)


def _words(options: dict[str, Any]) -> list[str]:
    words: list[str] = []
    for name, value in options.items():
        flag = "--" + name.replace("_", "-")
        for one in value if isinstance(value, (list, tuple)) else [value]:
            if one is True:
                words.append(flag)
            elif one is not None and one is not False:
                words.append(f"{flag}={os.fspath(one) if isinstance(one, os.PathLike) else one}")
    return words
