"""The demand: how far the trajectory may send, published by whoever consumes its samples."""

from typing import TYPE_CHECKING

from std_msgs.msg import UInt64

from piezo_ros.nodes.qos import LATCHED

if TYPE_CHECKING:
    from piezo_ros.nodes.stage import Stage

__all__ = ['DemandWriter']


class DemandWriter:
    """
    Publishes an index that leads the consumed one, renewed each half.

    Parameters
    ----------
    stage : Stage
        The consumer.
    lookahead_samples : int
        How far the demand leads.

    """

    def __init__(self, stage: 'Stage', lookahead_samples: int) -> None:
        self._lookahead = lookahead_samples
        self._publisher = stage.create_own_publisher(UInt64, 'demand', LATCHED)
        self._renew_at = 0

    def start(self, consumed: int) -> None:
        """Ask for the first samples."""
        self._renew_at = consumed
        self.update(consumed)

    def update(self, consumed: int) -> None:
        """Ask for more once half of it is consumed."""
        if consumed >= self._renew_at:
            self._renew_at = consumed + (self._lookahead + 1) // 2
            self._publisher.publish(UInt64(data=consumed + self._lookahead))
