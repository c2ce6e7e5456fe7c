"""The compensator: linearised command in, voltage out, through the inverse MRC model."""

from piezo_ros.model.hysteresis import HysteresisParameters
from piezo_ros.model.stepping import compensator_stepper
from piezo_ros.nodes.parameters import read
from piezo_ros.nodes.stage import Stage

__all__ = ['Compensator']


class Compensator(Stage):
    """Answers every block of ``command`` with a block of ``voltage``."""

    inputs = ('command',)
    outputs = ('voltage',)

    def __init__(self, *, compiled: bool = False) -> None:
        super().__init__('compensator', compiled=compiled)

    def configure(self) -> None:
        """Read the hysteresis to invert."""
        self._hysteresis = read(self, HysteresisParameters)

    def start(self) -> None:
        """Assume a virgin stage."""
        self._inverse = compensator_stepper(self._hysteresis, compiled=self.settings.compiled)
        self._command = self.readers['command']
        self._voltage = self.writers['voltage']

    def poll(self) -> bool:
        """Answer one block."""
        sample = self._command.take_one()
        if sample is not None:
            self._voltage.publish_one(self._inverse(sample))
            return True
        samples = self._command.take_other()
        if samples is None:
            return False
        if samples:
            self._voltage.publish([self._inverse(sample) for sample in samples])
        else:
            self.finish()
        return True
