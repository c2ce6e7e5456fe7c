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

"""Rescue of a bag that its recorder did not come to close."""

from pathlib import Path

from piezo_ros.bag import BagError, BagWriteError, salvage
from piezo_ros.parameters.errors import failure_text

__all__ = ['rescue']


def rescue(bag: Path) -> list[str]:
    """
    Make a whole bag of one that was not closed.

    Parameters
    ----------
    bag : Path
        Bag directory; it may be whole, or not exist.

    Returns
    -------
    list of str
        What was done, empty for nothing.

    """
    if (bag / 'metadata.yaml').is_file() or not bag.exists():
        return []
    cut = bag.with_name(f'{bag.name}.cut')
    try:
        bag.rename(cut)
    except OSError as error:
        return [f'the bag was not closed and is left as it is ({failure_text(error)}): {bag}']
    try:
        result = salvage(cut, bag)
    except BagWriteError as error:
        cut.rename(bag)
        return [(
            f'the bag was not closed; {error.whole_messages} messages of it are whole, but a bag '
            f'of them cannot be written beside it ({error.cause}): `piezo bag salvage {bag} '
            '-o DIR` saves them where there is room')]
    except BagError as error:
        return [
            f'the bag was not closed and nothing of it is whole ({error}); it is kept in {cut}']
    count = sum(result.messages.values())
    return [f'the bag was not closed; {count} messages of it were saved, the rest is in {cut}']
