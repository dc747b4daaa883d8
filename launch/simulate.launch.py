"""The simulated bench: no device is needed."""

import time

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    share = FindPackageShare('impactscope')
    options = {
        'source': 'simulated',
        'simulated.campaign': LaunchConfiguration('campaign'),
        'simulated.seed': ParameterValue(LaunchConfiguration('seed'), value_type=int),
        # both devices begin together
        'start_at': time.time() + 3.0,
        'wait_for_subscribers': ['synced', 'events'],
    }
    drivers = [
        LifecycleNode(
            package='impactscope',
            executable=name,
            name=name,
            namespace=LaunchConfiguration('bench'),
            parameters=[
                LaunchConfiguration('params_file'),
                options,
                {'publish_test_points': name == 'force_driver'},
            ],
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
            DeclareLaunchArgument(
                'campaign', default_value='hand_pass', description='which blows are simulated'
            ),
            DeclareLaunchArgument('seed', default_value='1', description='of the noise'),
            IncludeLaunchDescription(
                PathJoinSubstitution([share, 'launch', 'bench.launch.py']),
                launch_arguments={'test_points': 'false'}.items(),
            ),
            *drivers,
        ]
    )
