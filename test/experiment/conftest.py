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

from pathlib import Path

import pytest
import yaml

CONFIG = Path(__file__).resolve().parents[2] / 'config'
FILES = [str(CONFIG / f'{name}.yaml') for name in ('rig', 'compensator', 'controller')]


@pytest.fixture
def config():
    return CONFIG


@pytest.fixture
def write_plan(tmp_path):
    """Write a plan; as text, or as what differs from a small plan that is allowed."""

    def write(text=None, **keys):
        path = tmp_path / 'plan.yaml'
        if text is None:
            plan = {'format_version': 1, 'parameter_files': FILES,
                    'runs': [{'scheme': 'ff', 'periods': 5}], **keys}
            text = yaml.safe_dump({key: value for key, value in plan.items() if value is not ...})
        path.write_text(text, encoding='utf-8')
        return path

    return write
