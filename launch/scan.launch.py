"""One scan: waveform, scheme and models; separate processes or composed, recorded or not."""

from pathlib import Path

from piezo_ros.nodes.launching import describe


def generate_launch_description():
    return describe(Path(__file__))
