"""The tree is an ordinary ROS package: colcon finds it, builds it, and its command runs."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PARTS = (
    'CMakeLists.txt',
    'package.xml',
    'msg',
    'srv',
    'src',
    'config',
    'launch',
    'bags',
    'scripts',
)
COLCON = [str(Path(sys.prefix) / 'bin' / 'colcon')]


@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    folder = tmp_path_factory.mktemp('workspace')
    package = folder / 'impactscope'
    package.mkdir()
    for part in PARTS:
        source = ROOT / part
        if source.is_dir():
            leave_out = shutil.ignore_patterns('__pycache__', '*.nb[ci]')
            shutil.copytree(source, package / part, ignore=leave_out)
        else:
            shutil.copy(source, package / part)
    return folder


def run(command, cwd, **extra):
    prefix = sys.prefix
    environment = {
        **os.environ,
        'AMENT_PREFIX_PATH': prefix,
        'CMAKE_PREFIX_PATH': prefix,
        'PATH': f'{prefix}/bin:{os.environ["PATH"]}',
        **extra,
    }
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )


def test_colcon_sees_an_ament_package(workspace):
    listed = run([*COLCON, 'list'], workspace)
    assert 'ros.ament_cmake' in listed.stdout, listed.stderr


@pytest.mark.slow
@pytest.mark.timeout(1200)  # compiles every message
def test_colcon_builds_it_and_the_command_runs(workspace):
    built = run(
        [
            *COLCON,
            'build',
            '--cmake-args',
            f'-DPython3_EXECUTABLE={sys.executable}',
            '-DBUILD_TESTING=OFF',
        ],
        workspace,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    prefix = workspace / 'install' / 'impactscope'
    assert (prefix / 'share' / 'impactscope' / 'launch' / 'replay.launch.py').exists()
    assert (prefix / 'lib' / 'impactscope' / 'force_driver').exists()
    packages = next(prefix.glob('lib/python3*/site-packages'))
    said = run(
        [
            str(prefix / 'bin' / 'impactscope'),
            'info',
            str(prefix / 'share/impactscope/bags/hammer_blow_1.mcap'),
        ],
        workspace,
        PYTHONPATH=str(packages),
        LD_LIBRARY_PATH=str(prefix / 'lib'),
    )
    assert said.returncode == 0, said.stderr
    assert 'force.hammer' in said.stdout
