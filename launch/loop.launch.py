"""The whole loop in one process, compiled: the quickest way to close it."""

from pathlib import Path

from piezo_ros.nodes.launching import describe


def generate_launch_description():
    return describe(Path(__file__))
