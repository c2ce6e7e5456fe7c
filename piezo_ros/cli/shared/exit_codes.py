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

"""Exit codes of the command line, as README and the tutorials promise them."""

from typing import Final

__all__ = ['EXIT_DONE', 'EXIT_FAILED', 'EXIT_LOSS', 'EXIT_POOR', 'EXIT_USAGE']

EXIT_DONE: Final = 0
EXIT_FAILED: Final = 1
EXIT_USAGE: Final = 2  # also a plan that cannot be run
EXIT_LOSS: Final = 3  # done, but data were lost
EXIT_POOR: Final = 4  # done, but the model does not explain its data
