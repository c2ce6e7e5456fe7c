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

"""Build of piezo_ros for colcon (ament_python) and for pip; all metadata lives here."""

import sys
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = 'piezo_ros'
HERE = Path(__file__).resolve().parent
NODES = (
    'plant', 'hardware_plant', 'compensator', 'controller', 'trajectory', 'recorder', 'loop',
    'stamped')
EXECUTABLES = (*NODES, 'learner', 'piezo')

# What the extra [ros], and with it `make demo` where no ROS is sourced, brings.
DEFAULT_DISTRIBUTION = 'jazzy'

# The wheels of each distribution; only the patch number may move, so that no two of them mix.
ROS_WHEELS = {
    'jazzy': [
        'ros-rclpy~=7.1.4',
        # rclpy does not pull a middleware in.
        'ros-rmw-fastrtps-cpp~=8.4.0',
        'ros-diagnostic-msgs~=5.3.0',
        'ros-std-msgs~=5.3.0',
        'ros-std-srvs~=5.3.0',
        'ros-lifecycle-msgs~=2.0.0',
        'ros-rcl-interfaces~=2.0.0',
        'ros-rosgraph-msgs~=2.0.0',
        'ros-sensor-msgs~=5.3.0',
    ],
    'kilted': [
        'ros-rclpy~=9.1.0',
        'ros-rmw-fastrtps-cpp~=9.3.0',
        'ros-diagnostic-msgs~=5.5.0',
        'ros-std-msgs~=5.5.0',
        'ros-std-srvs~=5.5.0',
        'ros-lifecycle-msgs~=2.3.0',
        'ros-rcl-interfaces~=2.3.0',
        'ros-rosgraph-msgs~=2.3.0',
        'ros-sensor-msgs~=5.5.0',
    ],
}

# `ros2 run` looks for executables in lib/<package>, pip puts them into bin.
WRAPPER = """\
#!/bin/sh
exec "$(dirname "$(readlink -f "$0")")/../../bin/{executable}" "$@"
"""


def files_below(folder: str) -> list[tuple[str, list[str]]]:
    """Return the data_files entries that install a source folder into the package's share."""
    entries: dict[str, list[str]] = {}
    for path in sorted((HERE / folder).rglob('*')):
        if path.is_file() and '__pycache__' not in path.parts:
            source = path.relative_to(HERE)
            entries.setdefault(f'share/{PACKAGE}/{source.parent}', []).append(str(source))
    return list(entries.items())


def wrappers() -> list[tuple[str, list[str]]]:
    """Write one shell wrapper per executable and return the data_files entry of all of them."""
    folder = Path('build', 'wrappers')
    (HERE / folder).mkdir(parents=True, exist_ok=True)
    for executable in EXECUTABLES:
        wrapper = HERE / folder / executable
        wrapper.write_text(WRAPPER.format(executable=executable))
        wrapper.chmod(0o755)
    return [(f'lib/{PACKAGE}', [str(folder / executable) for executable in EXECUTABLES])]


data_files = [
    ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
    (f'share/{PACKAGE}', ['package.xml']),
    *files_below('config'),
    *files_below('launch'),
]
if 'bdist_wheel' in sys.argv:
    # colcon installs real executables into lib/<package> and must not find wrappers there.
    data_files += wrappers()

setup(
    name=PACKAGE,
    version='0.1.0',
    description=(
        'Feedback/feedforward control of a hysteresis-compensated piezoelectric actuator '
        'as lockstep ROS 2 nodes'),
    long_description=(HERE / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    maintainer='piezo_ros maintainers',
    maintainer_email='maintainers@example.com',
    license='Apache-2.0',
    keywords=[
        'piezo', 'nanopositioning', 'hysteresis', 'feedforward', 'system identification', 'ROS 2',
        'atomic force microscopy'],
    classifiers=[
        'Intended Audience :: Science/Research',
        'Operating System :: OS Independent',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3.10',
        'Programming Language :: Python :: 3.11',
        'Programming Language :: Python :: 3.12',
        'Programming Language :: Python :: 3.13',
        'Topic :: Scientific/Engineering',
        'Typing :: Typed',
    ],
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    # Named one by one: the caches that numba leaves beside the modules are of this machine alone.
    include_package_data=False,
    package_data={
        PACKAGE: ['py.typed'],
        f'{PACKAGE}.live.view': ['templates/*'],
        f'{PACKAGE}.runtime.process': ['*.xml'],
        f'{PACKAGE}.report.page': ['templates/*', 'static/*'],
        f'{PACKAGE}.study.beyond': ['best_known.csv'],
    },
    data_files=data_files,
    zip_safe=False,
    # The oldest are what Ubuntu 22.04 brings, or the first with wheels for Python 3.10; as they
    # stand here, `make test-matrix` installs and tests them (.ci/requirements).
    install_requires=[
        'argcomplete>=2.0.0',
        'clarabel>=0.6.0',
        'control>=0.9.4',
        'jinja2>=3.0.3',
        'lz4>=4.0.0',
        'matplotlib>=3.5.1',
        'mcap>=1.5.0',  # Writer.flush
        'numba>=0.55.1',
        'numpy>=1.21.5',
        'pyyaml>=6.0',
        'scipy>=1.8.0',
        'zstandard>=0.16.0',
    ],
    extras_require={
        'ros': ROS_WHEELS[DEFAULT_DISTRIBUTION],
        **ROS_WHEELS,
        # piezo sweep --engine dask, and its results as Parquet.
        'dask': ['distributed>=2024.1', 'pyarrow>=14'],
        # piezo bag import and export: MATLAB 7.3 and HDF5, TDMS, Parquet. The rest needs nothing.
        'data': ['h5py>=3.7', 'npTDMS>=1.6', 'pyarrow>=14'],
        # Images of scans as Gwyddion files.
        'images': ['gwyfile>=0.2'],
        # A stage behind a card of National Instruments, or a controller on a serial port. nidaqmx
        # needs a newer NumPy than the oldest above: the tests of the oldest go without it.
        'ni': ['grpcio>=1.49', 'nidaqmx[grpc]>=1.0.2'],
        'gcs': ['pyserial>=3.5'],
        # The site of the documentation: make docs.
        'docs': [
            'ipykernel',
            'myst-nb>=1.1',
            'numpydoc>=1.7',
            'pydata-sphinx-theme>=0.15',
            'sphinx>=7.2',
            'sphinx-copybutton>=0.5',
            'sphinx-gallery>=0.17',
        ],
        'test': [
            # Both with the Chromium of the distribution: apt-get install chromium.
            'axe-playwright-python>=0.1.4',
            'playwright>=1.50',
            'catkin_pkg',
            'colcon-common-extensions',
            'distributed>=2024.1',
            'gwyfile>=0.2',
            'h5py>=3.7',
            'hypothesis>=6.100',
            'import-linter>=2',
            'mcap-ros2-support>=0.5',
            'mypy>=1.13',
            'npTDMS>=1.6',
            'pyarrow>=14',
            'pyserial>=3.5',
            # pytest 9 breaks launch_testing's plug-in where a sourced ROS brings it in.
            'pytest>=7.4,<9',
            # By this spelling: where colcon test reads pytest-cov it measures on its own account.
            'pytest_cov>=7',
            'pytest-timeout>=2.2',
            'pytest-xdist>=3.5',
            'rosbags>=0.10',
            'ruff>=0.9',
            'scipy-stubs',
            # From 80 on, colcon build --symlink-install copies in place of linking.
            'setuptools>=65,<80',
            'types-PyYAML',
        ],
    },
    entry_points={
        'console_scripts': [
            *(f'{node} = {PACKAGE}.nodes.executables:{node}' for node in NODES),
            f'learner = {PACKAGE}.cli.executables.learner_executable:learner',
            f'piezo = {PACKAGE}.cli.main:main',
        ],
    },
)
