# Copyright 2026 piezo_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Reading of all samples of a run from a bag, whichever program recorded it."""

from pathlib import Path

from piezo_ros.bag.contents import Contents
from piezo_ros.bag.recorded_run import Run, Samples, run_of
from piezo_ros.bag.samples.sinks import Collected

__all__ = ['read']


def read(
    path: Path | str, *, namespace: str | None = None, allow_loss: bool = False,
    keep_not_finite: bool = False, run: int | None = None,
) -> Run:
    """
    Read the streams of one run from a bag.

    A topic of type ``std_msgs/msg/Float64MultiArray`` is a stream if the record of the bag names
    it, if the last component of its name is one of `STREAMS`, or if its first message has the
    label of a stream (a remapped topic). Other topics are ignored. Log times are not used.

    Parameters
    ----------
    path : Path or str
        A rosbag2 directory with MCAP storage, or one MCAP file.
    namespace : str, optional
        Namespace of the rig; needed only where several rigs are in the bag.
    allow_loss : bool, optional
        Whether to read a damaged bag up to the damage; `Run.lost` then names the losses. By
        default a damaged bag is refused.
    keep_not_finite : bool, optional
        Whether samples that are NaN or infinite belong to the run, for an analysis that can leave
        them out; by default they are damage.
    run : int, optional
        Which run to read where the bag has several, one after the other, counted from 1; needed
        only there.

    Returns
    -------
    Run
        The run.

    Raises
    ------
    BagError
        If the bag cannot be read, has another format version, no stream or several rigs, or is
        damaged: cut off, a gap or an overlap of indices, a changed sample period, a sample that
        is not finite.

    """
    path = Path(path)
    contents = Contents(path, Collected, keep_not_finite=keep_not_finite, run=run)
    facts = contents.facts(namespace, allow_loss=allow_loss)
    return run_of(path, facts, {
        stream: Samples(assembler.start_index, sink.samples())
        for stream, (assembler, sink) in facts.streams.items()})
