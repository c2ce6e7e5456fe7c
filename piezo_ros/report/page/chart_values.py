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
"""Values of a chart as its page has them: 32-bit floats in Base64."""

import base64

import numpy as np
from numpy.typing import NDArray

__all__ = ['as_base64']


def as_base64(values: NDArray[np.float64]) -> str:
    """Return values as little-endian 32-bit floats; what is not finite becomes NaN."""
    limit = np.finfo(np.float32).max
    single = np.clip(np.where(np.isfinite(values), values, np.nan), -limit, limit)
    return base64.b64encode(single.astype('<f4').tobytes()).decode()
