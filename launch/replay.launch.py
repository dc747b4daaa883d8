"""A recording instead of the devices: ros2 launch impactscope replay.launch.py bag:=FILE."""

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
                launch_arguments={'test_points': 'false', 'use_sim_time': 'true'}.items(),
            ),
            IncludeLaunchDescription(
                PathJoinSubstitution([folder, 'devices.launch.py']),
                launch_arguments={'source': 'replay', 'publish_clock': 'true'}.items(),
            ),
        ]
    )
