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
