"""The compensator: linearised command in, voltage out, through the inverse MRC model."""

from piezo_ros.model.hysteresis import HysteresisParameters, hysteresis_constants, inverse_step
from piezo_ros.nodes.parameters import read
from piezo_ros.nodes.stage import Stage

__all__ = ['Compensator']


class Compensator(Stage):
    """Answers every block of ``command`` with a block of ``voltage``."""

    inputs = ('command',)
    outputs = ('voltage',)

    def __init__(self) -> None:
        super().__init__('compensator')

    def configure(self) -> None:
        """Make the constants of the inverse model."""
        self._constants = hysteresis_constants(read(self, HysteresisParameters))

    def start(self) -> None:
        """Assume a virgin stage."""
        self._play_um = [0.0] * len(self._constants.width_um)
        self._command = self.readers['command']
        self._voltage = self.writers['voltage']

    def poll(self) -> bool:
        """Answer one block."""
        block = self._command.take()
        if block is None:
            return False
        samples = block.samples
        if len(samples) == 1:
            self._voltage.publish_one(inverse_step(self._play_um, self._constants, samples[0]))
        elif samples:
            self._voltage.publish(
                [inverse_step(self._play_um, self._constants, sample) for sample in samples])
        else:
            self.finish()
        return True
