"""Style, types and the direction of imports, each by the tool that `make lint` calls."""

import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


def check_with(tool, *arguments):
    executable = Path(sys.executable).with_name(tool)
    if not executable.exists():
        pytest.skip(f'{tool} is not installed beside {sys.executable}')
    run = subprocess.run(
        [executable, *arguments], cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if run.returncode:
        pytest.fail(run.stdout + run.stderr, pytrace=False)


def test_the_style_is_that_of_the_project():
    check_with('ruff', 'check', '--output-format=concise')


def test_the_types_hold():
    check_with('mypy')


def test_imports_point_downwards_and_ros_stays_at_the_top():
    check_with('lint-imports')
