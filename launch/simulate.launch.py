"""The simulated bench: no device is needed. Arguments: campaign, seed, bench, record_to, …"""

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    folder = PathJoinSubstitution([FindPackageShare('impactscope'), 'launch'])
    return LaunchDescription(
        [
            IncludeLaunchDescription(
                PathJoinSubstitution([folder, 'bench.launch.py']),
                launch_arguments={'test_points': 'false'}.items(),
            ),
            IncludeLaunchDescription(
                PathJoinSubstitution([folder, 'devices.launch.py']),
                launch_arguments={'source': 'simulated'}.items(),
            ),
        ]
    )
