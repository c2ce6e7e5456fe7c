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

"""The stack of a process that dies of a signal such as SIGSEGV, into its log."""

import contextlib
import faulthandler

__all__ = ['report_crashes']


def report_crashes() -> None:
    """Let Python print the stacks of all threads on the error output when the process dies."""
    if faulthandler.is_enabled():  # by the user, or by a test runner, into a file of their own
        return
    # Without an error output, or with one that is no file, there is nowhere to print to.
    with contextlib.suppress(AttributeError, ValueError, OSError, RuntimeError):
        faulthandler.enable()
