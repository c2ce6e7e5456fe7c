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

import ast
import functools
import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import setuptools

REPOSITORY = Path(__file__).resolve().parents[1]
EXECUTABLES = [
    'plant', 'hardware_plant', 'compensator', 'controller', 'trajectory', 'recorder', 'loop',
    'stamped', 'learner', 'piezo']

# Name in an import statement -> (name on PyPI, rosdep key).
THIRD_PARTY = {
    # matplotlib brings Pillow.
    'PIL': ('matplotlib', 'python3-matplotlib'),
    'argcomplete': ('argcomplete', 'python3-argcomplete'),
    'control': ('control', 'python-control-pip'),
    'jinja2': ('jinja2', 'python3-jinja2'),
    # mcap-ros2-support brings mcap, and that lz4 and zstandard.
    'lz4': ('lz4', 'mcap-ros2-support'),
    # jinja2 brings markupsafe.
    'markupsafe': ('jinja2', 'python3-jinja2'),
    'matplotlib': ('matplotlib', 'python3-matplotlib'),
    'mcap': ('mcap', 'mcap-ros2-support'),
    'mpl_toolkits': ('matplotlib', 'python3-matplotlib'),
    'numba': ('numba', 'python3-numba'),
    'numpy': ('numpy', 'python3-numpy'),
    'scipy': ('scipy', 'python3-scipy'),
    'yaml': ('pyyaml', 'python3-yaml'),
    'zstandard': ('zstandard', 'mcap-ros2-support'),
}
# Name in an import statement -> extra that brings it; what does without says so.
OPTIONAL = {
    'distributed': 'dask', 'grpc': 'ni', 'gwyfile': 'images', 'h5py': 'data', 'nidaqmx': 'ni',
    'nptdms': 'data', 'pyarrow': 'data', 'serial': 'gcs'}
# Names on PyPI where they are others.
DISTRIBUTIONS = {'grpc': 'grpcio', 'serial': 'pyserial'}
# Without a key in rosdep; what does without says so.
FROM_PIP_ALONE = {'clarabel'}


def arguments_of_setup(folder, command):
    """Return what setup.py hands to setuptools, as run by the given command."""
    handed = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(sys, 'argv', ['setup.py', command])
        patch.setattr(setuptools, 'setup', lambda **arguments: handed.update(arguments))
        runpy.run_path('setup.py', run_name='__main__')
    return handed


@pytest.fixture(scope='module')
def metadata():
    return arguments_of_setup(REPOSITORY, 'build')


@pytest.fixture(scope='module')
def manifest():
    return ElementTree.parse(REPOSITORY / 'package.xml').getroot()


def requirement_names(requirements):
    return {re.split(r'[^\w.-]', requirement)[0].lower() for requirement in requirements}


@functools.cache
def parsed(path):
    return ast.parse(path.read_text(encoding='utf-8'))


@functools.cache
def imported_names(*folders):
    names = set()
    for path in (path for folder in folders for path in (REPOSITORY / folder).rglob('*.py')):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.Import):
                names |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module.split('.')[0])
    return names - sys.stdlib_module_names - {'piezo_ros'}


def test_one_version_is_told_everywhere(metadata, manifest):
    assert metadata['version'] == manifest.findtext('version')


def test_setup_and_manifest_agree_on_who_and_under_which_licence(metadata, manifest):
    maintainer = manifest.find('maintainer')
    assert metadata['name'] == manifest.findtext('name')
    assert metadata['maintainer'] == maintainer.text
    assert metadata['maintainer_email'] == maintainer.get('email')
    assert metadata['license'] == manifest.findtext('license')


def test_the_licence_is_there_in_full(manifest):
    text = (REPOSITORY / manifest.find('license').get('file')).read_text(encoding='utf-8')
    assert 'Version 2.0, January 2004' in text
    assert 'END OF TERMS AND CONDITIONS' in text


def test_every_executable_is_a_console_script(metadata):
    scripts = metadata['entry_points']['console_scripts']
    assert [script.split(' = ')[0] for script in scripts] == EXECUTABLES


@pytest.mark.parametrize('executable', EXECUTABLES)
def test_a_console_script_calls_a_function_that_exists(metadata, executable):
    scripts = dict(script.split(' = ') for script in metadata['entry_points']['console_scripts'])
    module, function = scripts[executable].split(':')
    # Read, not imported, so that it holds on a laptop without ROS too.
    source = (REPOSITORY / module.replace('.', '/')).with_suffix('.py').read_text(encoding='utf-8')
    assert function in {
        node.name for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)}


def test_the_manifest_names_what_the_code_imports(manifest):
    keys = {dependency.text for dependency in manifest.iter('exec_depend')}
    names = imported_names('piezo_ros', 'launch') - OPTIONAL.keys() - FROM_PIP_ALONE
    needed = {THIRD_PARTY.get(name, (None, name))[1] for name in names}
    assert needed <= keys


def test_pip_installs_what_the_code_imports_beside_ros(metadata, manifest):
    from_ros = {dependency.text for dependency in manifest.iter('exec_depend')}
    names = imported_names('piezo_ros') - from_ros - OPTIONAL.keys()
    needed = {THIRD_PARTY.get(name, (name,))[0] for name in names}
    assert needed <= requirement_names(metadata['install_requires'])


@pytest.mark.parametrize(('name', 'extra'), OPTIONAL.items())
def test_an_extra_brings_what_is_imported_only_where_it_is_needed(metadata, name, extra):
    assert name in imported_names('piezo_ros')
    distribution = DISTRIBUTIONS.get(name, name)
    assert distribution in requirement_names(metadata['extras_require'][extra])
    for path in (REPOSITORY / 'piezo_ros').rglob('*.py'):
        for statement in parsed(path).body:
            if isinstance(statement, ast.Import | ast.ImportFrom):
                # As a word: rclpy has a module serialization.
                assert not re.search(rf'\b{name}\b', ast.unparse(statement)), path


@pytest.mark.parametrize('extra', ['ros', 'jazzy', 'kilted'])
def test_the_ros_extras_bring_every_ros_package_that_the_manifest_names(metadata, manifest, extra):
    keys = {dependency.text for dependency in manifest.iter('exec_depend')}
    from_ros = keys - {key for _, key in THIRD_PARTY.values()}
    # launch and launch_ros are not on PyPI: launch files need a ROS installation.
    wheels = {f'ros-{key.replace("_", "-")}' for key in from_ros - {'launch', 'launch_ros'}}
    assert wheels <= requirement_names(metadata['extras_require'][extra])


def test_every_data_file_beside_the_code_is_packaged(metadata):
    package = REPOSITORY / 'piezo_ros'
    packaged = {
        path for name, patterns in metadata['package_data'].items() for pattern in patterns
        for path in (REPOSITORY / name.replace('.', '/')).glob(pattern)}
    there = {
        path for path in package.rglob('*')
        if path.is_file() and path.suffix != '.py' and '__pycache__' not in path.parts}
    assert package / 'py.typed' in there
    assert there == packaged


@pytest.fixture(scope='module')
def sources(tmp_path_factory):
    """Copy what git would commit from the work tree, without what was built in it."""
    listed = subprocess.run(
        ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard'],
        cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip(f'the sources are no git work tree: {listed.stderr.strip()}')
    copy = tmp_path_factory.mktemp('workspace') / 'src' / 'piezo_ros'
    for name in filter(None, listed.stdout.split('\0')):
        # A file just removed is still listed.
        if (REPOSITORY / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(REPOSITORY / name, copy / name)
    return copy


def colcon(workspace, *arguments, python_path=''):
    executable = Path(sys.executable).with_name('colcon')
    if not executable.exists():
        pytest.skip(f'colcon is not installed beside {sys.executable}')
    prefixes = filter(None, [sys.prefix, os.environ.get('AMENT_PREFIX_PATH')])
    environment = os.environ | {
        'AMENT_PREFIX_PATH': os.pathsep.join(prefixes), 'COLCON_HOME': str(workspace / '.colcon'),
        'PYTHONPATH': python_path}
    run = subprocess.run(
        [executable, '--log-base', 'log', *arguments],
        cwd=workspace, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


def test_colcon_takes_it_for_an_ament_python_package(sources):
    assert colcon(sources.parents[1], 'list').split() == [
        'piezo_ros', str(Path('src', 'piezo_ros')), '(ros.ament_python)']


def assert_installed(sources, prefix, *, linked):
    """Assert that what ros2 run and ros2 launch look for is there."""
    share = prefix / 'share' / 'piezo_ros'
    assert (prefix / 'share/ament_index/resource_index/packages/piezo_ros').is_file()
    assert (share / 'package.xml').is_file()
    for executable in EXECUTABLES:
        assert os.access(prefix / 'lib' / 'piezo_ros' / executable, os.X_OK), executable
    data = [
        path.relative_to(sources) for folder in ('config', 'launch')
        for path in (sources / folder).rglob('*') if path.is_file()]
    assert {Path('launch/scan.launch.py'), Path('config/layouts/foxglove.json')} <= {*data}
    for path in data:
        assert (share / path).read_bytes() == (sources / path).read_bytes()
        assert (share / path).is_symlink() == linked, path
    if not linked:
        package = next((prefix / 'lib').glob('python*/site-packages/piezo_ros'))
        assert (package / 'py.typed').is_file()
        assert not list(package.rglob('*.nb[ci]'))


def in_workspace(workspace, *words):
    """Return a command that runs in a shell where the workspace is sourced."""
    setup = str(workspace / 'install' / 'local_setup.bash')
    return ['bash', '-c', '. "$0"; exec "$@"', setup, *words]


def assert_executables_start(workspace):
    """Start every installed executable as ros2 run does, outside the sources."""
    lib = workspace / 'install' / 'piezo_ros' / 'lib' / 'piezo_ros'
    code = 'import piezo_ros; print(piezo_ros.__file__)'
    where = subprocess.run(
        in_workspace(workspace, sys.executable, '-c', code),
        cwd=workspace, capture_output=True, text=True, check=True).stdout
    assert Path(where.strip()).is_relative_to(workspace)
    told = subprocess.run(
        in_workspace(workspace, lib / 'piezo', '--help'), cwd=workspace, capture_output=True,
        text=True, check=True).stdout
    assert 'usage: piezo' in told
    assert_nodes_start(workspace, lib)


def assert_nodes_start(workspace, lib):
    rclpy = pytest.importorskip('rclpy')
    context = rclpy.Context()
    namespace = f'/installed_{os.getpid()}'
    processes = [subprocess.Popen(
        in_workspace(
            workspace, lib / executable, '--ros-args', '-r', f'__ns:={namespace}/{executable}',
            '-p', 'autostart:=false'),
        cwd=workspace, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
        for executable in EXECUTABLES if executable != 'piezo']
    nodes = {
        'loop': ['compensator', 'controller', 'plant', 'trajectory'], 'hardware_plant': ['plant']}
    expected = {
        (node, f'{namespace}/{executable}') for executable in EXECUTABLES if executable != 'piezo'
        for node in nodes.get(executable, [executable])}
    rclpy.init(args=[], context=context)
    onlooker = rclpy.create_node('onlooker', context=context)
    try:
        deadline = time.monotonic() + 90.0
        while not expected <= {*onlooker.get_node_names_and_namespaces()}:
            assert all(process.poll() is None for process in processes)
            assert time.monotonic() < deadline, onlooker.get_node_names_and_namespaces()
            time.sleep(0.05)
        for process in processes:
            process.send_signal(signal.SIGINT)
        for process in processes:
            # Nothing ran that could have been cut short.
            assert process.wait(60.0) in (0, 1)
    finally:
        for process in processes:
            process.kill()
            process.wait()
        onlooker.destroy_node()
        rclpy.try_shutdown(context=context)


@pytest.mark.parametrize('option', [
    None, pytest.param('--symlink-install', marks=pytest.mark.slow)])
def test_colcon_builds_what_ros2_run_and_launch_look_for(sources, tmp_path, option):
    colcon(tmp_path, 'build', '--base-paths', str(sources), *filter(None, [option]))
    assert_installed(sources, tmp_path / 'install' / 'piezo_ros', linked=option is not None)
    assert_executables_start(tmp_path)


# What Ubuntu 22.04 and 24.04 or Debian 12 ship, and the last one with all that colcon needs.
@pytest.mark.slow
@pytest.mark.parametrize('version', ['65.5.1', '68.1.2', '79.0.1'])
@pytest.mark.parametrize('option', [None, '--symlink-install'])
def test_colcon_builds_with_each_generation_of_setuptools(sources, tmp_path, version, option):
    overlay = tmp_path / 'overlay'
    subprocess.run(
        [sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps', '--target', overlay,
         f'setuptools=={version}'], check=True)
    told = subprocess.run(
        [sys.executable, '-c', 'import setuptools; print(setuptools.__version__)'],
        env={**os.environ, 'PYTHONPATH': str(overlay)}, capture_output=True, text=True, check=True)
    assert told.stdout.strip() == version
    colcon(
        tmp_path, 'build', '--base-paths', str(sources), *filter(None, [option]),
        python_path=str(overlay))
    assert_installed(sources, tmp_path / 'install' / 'piezo_ros', linked=option is not None)
    assert_executables_start(tmp_path)


def test_colcon_test_runs_the_tests_and_tells_of_them(sources, tmp_path):
    base = ('--base-paths', str(sources))
    colcon(tmp_path, 'build', *base)
    # One file of them: the point is that colcon finds tests and runs them.
    colcon(
        tmp_path, 'test', *base, '--return-code-on-test-failure', '--pytest-args',
        'test/streams/test_codec.py')
    (told,) = re.findall(
        r'(\d+) tests, 0 errors, 0 failures', colcon(tmp_path, 'test-result', '--all'))[-1:]
    assert int(told) > 10


def test_a_wheel_brings_wrappers_that_ros2_run_can_start(sources, tmp_path):
    wrappers = dict(arguments_of_setup(sources, 'bdist_wheel')['data_files'])['lib/piezo_ros']
    assert sorted(Path(wrapper).name for wrapper in wrappers) == sorted(EXECUTABLES)
    (tmp_path / 'bin').mkdir()
    (tmp_path / 'lib' / 'piezo_ros').mkdir(parents=True)
    for wrapper in wrappers:
        script = tmp_path / 'bin' / Path(wrapper).name
        script.write_text('#!/bin/sh\nprintf "%s|" "$(basename "$0")" "$@"\n', encoding='utf-8')
        script.chmod(0o755)
        installed = shutil.copy(sources / wrapper, tmp_path / 'lib' / 'piezo_ros')
        run = subprocess.run(
            [installed, '--ros-args', 'two words'], capture_output=True, text=True, check=True)
        assert run.stdout == f'{script.name}|--ros-args|two words|'


@pytest.mark.parametrize('command', ['build', 'develop', 'editable_wheel'])
def test_only_a_wheel_brings_wrappers(sources, command):
    assert 'lib/piezo_ros' not in dict(arguments_of_setup(sources, command)['data_files'])
