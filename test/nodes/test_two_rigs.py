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

"""Two rigs in two namespaces of one domain, at once: nothing of one is seen in the other."""

import numpy as np
import pytest
import yaml

from piezo_ros.bag import STREAMS, read


def _plan(path, content, **run):
    path.write_text(yaml.safe_dump({**content, 'runs': [run]}))
    return path


@pytest.mark.slow  # test_live_campaign.py has two rigs at once every time.
def test_two_rigs_give_at_once_what_each_gives_alone(rig, make_rig, write_plan, tmp_path):
    content = yaml.safe_load(write_plan('fbff').read_text())
    # Long enough to be at work at the same time.
    plans = {
        '--separate': _plan(
            tmp_path / 'separate.yaml', content, scheme='fbff', amplitude_um=1.5, periods=12,
            plant={'seed': 11}),
        '--composed': _plan(
            tmp_path / 'composed.yaml', content, scheme='fb', amplitude_um=0.7, periods=40,
            plant={'seed': 22})}
    rigs = dict(zip(plans, (rig, make_rig()), strict=True))
    rigs['--composed'].environment['ROS_DOMAIN_ID'] = rig.environment['ROS_DOMAIN_ID']
    live = {
        how: rigs[how].piezo('run', plan, '-o', tmp_path / how / 'live', how)
        for how, plan in plans.items()}
    offline = {
        how: rigs[how].piezo('simulate', plan, '-o', tmp_path / how / 'offline')
        for how, plan in plans.items()}
    for how in plans:
        assert live[how].wait() == 0, live[how].output
        assert offline[how].wait() == 0, offline[how].output
        (bag,) = (tmp_path / how / 'live' / 'bags').iterdir()
        run, expected = read(bag), read(tmp_path / how / 'offline' / 'bags' / bag.name)
        assert run.namespace == rigs[how].namespace
        for stream in STREAMS:
            np.testing.assert_array_equal(run.whole(stream)[1], expected.whole(stream)[1])
        # An ordinary run has nothing to warn of.
        for log in (tmp_path / how / 'live' / 'logs').rglob('*.log'):
            for word in ('WARN', 'ERROR', 'Warning', 'Traceback'):
                assert word not in log.read_text(), log.read_text()
