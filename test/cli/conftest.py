import pytest

PLAN = """\
format_version: 1
title: A small plan
runs: [{scheme: [ff, fbff], periods: 5}]
"""


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / 'plan.yaml'
    path.write_text(PLAN)
    return path
