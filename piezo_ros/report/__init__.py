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

"""
Scores, tables, figures and the HTML page of recorded runs.

The modules of this folder compute numbers and plain-text tables. `piezo_ros.report.figures` draws
with Matplotlib, `piezo_ros.report.page` writes report.html; importing `piezo_ros.report` imports
neither of the two.
"""

from piezo_ros.report.metrics import Nonlinearity, nonlinearity, nrmse
from piezo_ros.report.score import ScoredRun, score

__all__ = ['Nonlinearity', 'ScoredRun', 'nonlinearity', 'nrmse', 'score']
