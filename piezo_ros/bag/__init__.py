"""Reading, writing and salvage of runs recorded in rosbag2 directories; needs no ROS."""

from piezo_ros.bag.block import STREAMS, Block, BlockCodec, MalformedBlockError
from piezo_ros.bag.errors import BagError, BagExistsError
from piezo_ros.bag.reader import read
from piezo_ros.bag.recording import Recording, open_recording
from piezo_ros.bag.run import Run
from piezo_ros.bag.salvage import Salvage, salvage
from piezo_ros.bag.writer import BagWriter

__all__ = [
    'STREAMS',
    'BagError',
    'BagExistsError',
    'BagWriter',
    'Block',
    'BlockCodec',
    'MalformedBlockError',
    'Recording',
    'Run',
    'Salvage',
    'open_recording',
    'read',
    'salvage',
]
