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

"""Devices in front of emulators, which the tests start by themselves."""

import importlib.util
import shutil

import pytest

NI_EXTRA = "nidaqmx[grpc] is not installed: pip install 'piezo_ros[ni]'"


COMPILER = next(filter(None, map(shutil.which, ('cc', 'gcc', 'clang'))), None)
# A call by gRPC takes a millisecond or two, and a test has hundreds.
WAYS = [pytest.param('grpc', marks=pytest.mark.slow), 'local'] if COMPILER else ['grpc']


def has(name):
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


@pytest.fixture
def make_card():
    """Make a virtual card; its output holds the operating point."""
    if not has('nidaqmx._stubs') or not has('grpc'):
        pytest.skip(NI_EXTRA)
    from daqmx.virtual_card import RigStage, VirtualCard

    def make(stage=None, *, held_v=5.0, **options):
        return VirtualCard(stage or RigStage(), held_v=held_v, **options)

    return make


@pytest.fixture
def card(make_card):
    return make_card()


@pytest.fixture
def serve():
    """Serve a card by gRPC until the end of the test; returns service and address."""
    import contextlib
    with contextlib.ExitStack() as stack:
        def start(card, address='127.0.0.1:0'):
            from daqmx.daqmx_service import served
            return stack.enter_context(served(card, address))
        yield start


@pytest.fixture(scope='session')
def shim_library(tmp_path_factory):
    if not has('nidaqmx'):
        pytest.skip(NI_EXTRA)
    if COMPILER is None:
        pytest.skip('no C compiler for the stand-in of the local driver')
    from daqmx.daqmx_shim import build
    return build(COMPILER, tmp_path_factory.mktemp('shim'))


@pytest.fixture(params=WAYS)
def ni(request, serve):
    """Make an NI device in front of a card, by either way to it, opened at 100 kHz."""
    import contextlib

    from piezo_ros.hardware.ni import NiDevice, NiParameters
    with contextlib.ExitStack() as stack:
        def make(card, sample_period_s=1e-5, **parameters):
            if request.param == 'grpc':
                address = serve(card)[1]
            else:
                from daqmx.daqmx_shim import installed
                stack.enter_context(installed(request.getfixturevalue('shim_library'), card))
                address = ''
            device = NiDevice(NiParameters(address=address, **{'timeout_s': 5.0, **parameters}))
            stack.callback(device.close)
            if sample_period_s:
                device.open(sample_period_s)
            return device
        yield make
