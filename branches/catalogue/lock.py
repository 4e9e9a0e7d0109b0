"""One writer at a time: a lock that the system releases when its holder dies, with a note that names the holder.

SQLite has no such lock: it locks a file for one transaction at a time, or keeps readers out.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from branches.catalogue.errors import CatalogueInUse
from branches.files import WriteFailure, reason

__all__ = ["WriterLock"]

_held: dict[str, int] = {}
"""Locks by path, with the number of the process that holds them. The system's locks belong to a process and would admit it twice. A forked
process has a copy of this, but none of the locks."""


class WriterLock:
    """Hold FILE.lock while FILE is written.

    A record lock (`fcntl.lockf`) belongs to a process and ends with it, also if it is killed. Forked workers do not inherit it. So a file
    that a killed process left behind locks nothing.

    Parameters
    ----------
    path : Path
        The file that will be written.

    Raises
    ------
    CatalogueInUse
        Naming the process that writes it: its number, host, and since when.
    WriteFailure
        If the directory cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path.with_name(path.name + ".lock")
        self._process = os.getpid()
        key = str(self._path)
        if _held.get(key) == self._process:
            raise CatalogueInUse(f"{path} is being written by this very process ({self._process})")
        while True:
            try:
                # Not truncated: its note may name the writer.
                self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
            except OSError as error:
                raise WriteFailure(f"cannot write {path}: {reason(error)}") from error
            try:
                _lock(self._file)
            except OSError:
                holder = _holder(self._file)
                os.close(self._file)
                raise CatalogueInUse(f"{path} is being written by {holder}; expected one writer at a time") from None
            # The last holder may have removed the file between the two calls. Then another file counts.
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
            # A full disk cannot take the note. The lock holds without it.
            pass
        _held[key] = self._process

    def release(self) -> None:
        """Release the lock. A process that was forked from the holder's does nothing."""
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

        # Far behind the note, so that it can be read.
        os.lseek(file, 1 << 20, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _same(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), os.stat(path))
    except FileNotFoundError:
        return False


def _holder(file: int) -> str:
    """The holder of the lock, as the note names it."""
    try:
        os.lseek(file, 0, os.SEEK_SET)
        note: Any = json.loads(os.read(file, 4096))
        return f"process {note['process']} on {note['host']} since {note['since']}"
    except (ValueError, KeyError, TypeError, OSError):
        return "another process"
