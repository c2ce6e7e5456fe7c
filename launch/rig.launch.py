"""The whole loop, one process for every node; leave out what you replace by your own."""

from pathlib import Path

from piezo_ros.nodes.launching import describe


def generate_launch_description():
    return describe(Path(__file__))
