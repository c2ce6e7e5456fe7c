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

"""The error every function of `piezo_ros.bag` raises for a bag that cannot be read or written."""

__all__ = ['BagError', 'BagExistsError', 'BagWriteError']


class BagError(Exception):
    """A bag that cannot be read or written; the text names the file, the place and the cause."""


class BagExistsError(BagError, FileExistsError):
    """The output of a writer exists already; nothing is ever overwritten."""


class BagWriteError(BagError):
    """
    A bag that cannot be written: no room, no permission, its directory deleted.

    Attributes
    ----------
    cause : str
        What the system says, without a file.
    whole_messages : int
        Of a failed salvage: the number of messages that are whole in the damaged bag.

    """

    def __init__(self, text: str, cause: str, whole_messages: int = 0) -> None:
        super().__init__(text)
        self.cause = cause
        self.whole_messages = whole_messages
