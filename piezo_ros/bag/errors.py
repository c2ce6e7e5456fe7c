"""The error every function of `piezo_ros.bag` raises for a bag that cannot be read or written."""

__all__ = ['BagError', 'BagExistsError']


class BagError(Exception):
    """A bag that cannot be read or written; the text names the file, the place and the cause."""


class BagExistsError(BagError, FileExistsError):
    """The output of a writer exists already; nothing is ever overwritten."""
