"""Motion files on disk and inside zip files, which are read without unpacking."""

from __future__ import annotations

import hashlib
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath, PurePosixPath
from typing import IO

from bodysense.arrays import check_member
from bodysense.errors import BodysenseError
from bodysense.files import read_bytes

SUFFIXES = (".bvh", ".npz")  # of files on disk; in a zip file only .bvh is looked for
ZIP = ".zip"
# Exceptions that a damaged, encrypted or foreign zip file raises when it is opened or read.
_BROKEN = (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, NotImplementedError, ValueError)


@dataclass(frozen=True, order=True)
class MotionFile:
    """A motion file on disk, or a member of the zip file at `path`.

    A zip file without a member must hold exactly one motion; otherwise reading raises BodysenseError.
    """

    path: Path
    member: str = ""  # name in the zip file; '' for a file of its own

    @property
    def place(self) -> Path:
        """Path for messages and names: `session1/take2.zip/take2_deep1.bvh`."""
        return self.path / self.member.lstrip("/") if self.member else self.path

    def inside(self, directory: Path) -> PurePosixPath:
        """Return the path relative to `directory`; a zip file counts as the folder of its unpacked copy."""
        place = PurePosixPath(self.path.relative_to(directory).as_posix())
        return place.with_suffix("") / self.member.lstrip("/") if self.path.suffix.lower() == ZIP else place

    def read(self) -> bytes:
        """Return all its bytes. Raises BodysenseError, naming the file, if it cannot be read or is empty."""
        if not self.member:
            data = read_bytes(self.path)
            if self.path.suffix.lower() != ZIP:
                return data
        with self._opened() as stream:
            return stream.read()

    def head(self, count: int = 512) -> bytes:
        """Return its first bytes; empty if it cannot be read (`read` raises the reason)."""
        try:
            with self._opened() as stream:
                return stream.read(count)
        except BodysenseError:
            return b""

    def sha256(self) -> str:
        """Return the hash of its bytes as hexadecimal digits; '' if it cannot be read (`read` raises the reason)."""
        try:
            with self._opened() as stream:
                return hashlib.file_digest(stream, "sha256").hexdigest()  # type: ignore[arg-type]
        except BodysenseError:
            return ""

    @contextmanager
    def _opened(self) -> Iterator[IO[bytes]]:
        is_whole_zip = self.path.suffix.lower() == ZIP and not self.member
        member = _only_member(self.path) if is_whole_zip else self.member
        try:
            if member:
                with zipfile.ZipFile(self.path) as archive, archive.open(member) as stream:
                    check_member(self.place, archive.getinfo(member))
                    yield stream
            else:
                with self.path.open("rb") as stream:
                    yield stream
        except KeyError:
            raise BodysenseError(f"{self.place}: the zip file has no such member; was it replaced?") from None
        except _BROKEN as error:
            if member:
                raise BodysenseError(f"{self.place}: {_damaged(error)}") from None
            raise BodysenseError(f"{self.path}: cannot be read ({getattr(error, 'strerror', error)})") from None


def motion_files(directory: Path) -> list[MotionFile]:
    """Return the .bvh and .npz files below a folder and the .bvh members of its zip files, sorted.

    A zip file next to its own unpacked copy is counted once, as the copy. A zip file that is damaged or has no .bvh is
    listed itself, so that reading it reports the error.
    """
    files: list[MotionFile] = []
    for path in (path for path in directory.rglob("*") if path.is_file() and not _is_shadow(path)):
        suffix = path.suffix.lower()
        if suffix in SUFFIXES:
            files.append(MotionFile(path))
        elif suffix == ZIP:
            try:
                members = _members(path)
            except _BROKEN:
                members = []
            files += [
                MotionFile(path, member)
                for member in members
                if not any((folder / member).is_file() for folder in (path.parent, path.with_suffix("")))
            ]
            files += [] if members else [MotionFile(path)]
    return sorted(set(files))


def _members(path: Path) -> list[str]:
    """Return the names of the BVH files in a zip file."""
    with zipfile.ZipFile(path) as archive:
        names = [entry.filename for entry in archive.infolist() if entry.filename.lower().endswith(".bvh")]
    return [name for name in names if not _is_shadow(PurePosixPath(name))]


def _is_shadow(path: PurePath) -> bool:
    """Whether the file is a resource fork that macOS writes next to others."""
    return path.name.startswith("._") or "__MACOSX" in path.parts


def _only_member(path: Path) -> str:
    """Return the only motion in a zip file. Raises BodysenseError if it holds no motion or several."""
    try:
        with zipfile.ZipFile(path) as archive:
            count = len(archive.infolist())
        members = _members(path)
    except _BROKEN as error:
        raise BodysenseError(f"{path}: {_damaged(error)}") from None
    if len(members) > 1:
        raise BodysenseError(
            f"{path}: a zip file of {len(members)} motions, not one; give the folder it lies in, or unpack it"
        )
    if not members:
        raise BodysenseError(
            f"{path}: no .bvh file among the {count} in this zip file; take it out of the folder or download it again"
        )
    return members[0]


def _damaged(error: Exception) -> str:
    reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    return f"cannot be read as a zip file ({reason}); copy or download it again"
