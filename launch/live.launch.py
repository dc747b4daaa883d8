"""A bench with its devices: the drivers as the parameter file says, and the analysis."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    share = FindPackageShare('impactscope')
    drivers = [
        LifecycleNode(
            package='impactscope',
            executable=name,
            name=name,
            namespace=LaunchConfiguration('bench'),
            parameters=[LaunchConfiguration('params_file')],
        )
        for name in ('force_driver', 'accelerometer_driver')
    ]
    return LaunchDescription(
        [
            DeclareLaunchArgument('bench', default_value='bench', description='namespace'),
            DeclareLaunchArgument(
                'params_file',
                default_value=PathJoinSubstitution([share, 'config', 'bench.yaml']),
                description='parameters of all nodes of the bench',
            ),
            IncludeLaunchDescription(PathJoinSubstitution([share, 'launch', 'bench.launch.py'])),
            *drivers,
        ]
    )
