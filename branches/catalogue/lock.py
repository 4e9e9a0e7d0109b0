"""One writer at a time: a lock that the system lets go when its holder dies, and a note beside it that says who holds it."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from branches.catalogue.errors import CatalogueInUse
from branches.files import WriteFailure, reason

__all__ = ["WriterLock"]

_held: dict[str, int] = {}
"""Locks of this process, with its number: the system's own belong to the process, and would let it in twice. A forked process has a
copy of this, but none of the locks."""


class WriterLock:
    """Holds FILE.lock while FILE is written.

    A record lock (`fcntl.lockf`) belongs to the process: it ends with it, however it ends, and is not handed on to the workers that
    it forks. So a file left behind by a killed process locks nothing.

    Parameters
    ----------
    path : Path
        The file that will be written.

    Raises
    ------
    CatalogueInUse
        Naming the process that writes it: its number, host, and since when.
    WriteFailure
        Where the directory cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path.with_name(path.name + ".lock")
        self._process = os.getpid()
        key = str(self._path)
        if _held.get(key) == self._process:
            raise CatalogueInUse(f"{path} is being written by this very process ({self._process})")
        while True:
            try:
                # Not truncated: it may say who writes.
                self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
            except OSError as error:
                raise WriteFailure(f"cannot write {path}: {reason(error)}") from error
            try:
                _lock(self._file)
            except OSError:
                told = _told(self._file)
                os.close(self._file)
                raise CatalogueInUse(f"{path} is being written by {told}; expected one writer at a time") from None
            # Its last holder may have removed the file between the two calls: then another one counts.
            if _same(self._file, self._path):
                break
            os.close(self._file)
        import datetime
        import socket

        since = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        note = json.dumps({"process": self._process, "host": socket.gethostname(), "since": since}).encode()
        try:
            os.ftruncate(self._file, 0)
            os.lseek(self._file, 0, os.SEEK_SET)
            os.write(self._file, note)
        except OSError:
            # A full disk cannot take the note; the lock holds without it.
            pass
        _held[key] = self._process

    def release(self) -> None:
        """Let go. A process that was forked from the holder's does nothing."""
        if self._file < 0 or os.getpid() != self._process:
            return
        self._path.unlink(missing_ok=True)
        os.close(self._file)
        self._file = -1
        _held.pop(str(self._path), None)


def _lock(file: int) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        # Far behind the note, which stays readable.
        os.lseek(file, 1 << 20, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _same(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), os.stat(path))
    except FileNotFoundError:
        return False


def _told(file: int) -> str:
    """Who holds the lock, as far as the note says."""
    try:
        os.lseek(file, 0, os.SEEK_SET)
        note: Any = json.loads(os.read(file, 4096))
        return f"process {note['process']} on {note['host']} since {note['since']}"
    except (ValueError, KeyError, TypeError, OSError):
        return "another process"
