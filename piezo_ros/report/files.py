"""Writing files so that a reader sees the old content or the new, never a half."""

import os
from pathlib import Path

__all__ = ['write_atomically']


def write_atomically(path: Path, content: bytes | str) -> None:
    """
    Write a file beside its place and rename it into it.

    Parameters
    ----------
    path : Path
        The file; its directory is made when missing.
    content : bytes or str
        What to write; text becomes UTF-8 with its line ends as they are.

    Raises
    ------
    OSError
        If the directory or the file cannot be written; the old file is then untouched.

    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f'.{path.name}.{os.getpid()}.tmp')
    try:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
