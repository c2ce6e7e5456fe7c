"""Settings of the middleware that must stand before rclpy is initialised."""

import os
from pathlib import Path

__all__ = ['set_middleware_defaults']


def set_middleware_defaults() -> None:
    """Set what the user has not set: see fastdds.xml; other middlewares ignore it."""
    # Shared-memory segments of killed processes make endpoints match without data.
    os.environ.setdefault('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    os.environ.setdefault(
        'FASTDDS_DEFAULT_PROFILES_FILE', str(Path(__file__).with_name('fastdds.xml')))
