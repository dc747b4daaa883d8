"""A recording instead of the devices: ros2 launch impactscope replay.launch.py bag:=FILE."""

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
        'source': 'replay',
        'replay.bag': LaunchConfiguration('bag'),
        'replay.rate': ParameterValue(LaunchConfiguration('rate'), value_type=float),
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
                {
                    'publish_test_points': name == 'force_driver',
                    'replay.publish_clock': name == 'force_driver',
                },
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
                'bag',
                default_value=PathJoinSubstitution([share, 'bags', 'simulated_hand_pass.mcap']),
                description='recording to play',
            ),
            DeclareLaunchArgument(
                'rate',
                default_value='1.0',
                description='of time; 0: as fast as the consumers take it',
            ),
            IncludeLaunchDescription(
                PathJoinSubstitution([share, 'launch', 'bench.launch.py']),
                launch_arguments={'test_points': 'false', 'use_sim_time': 'true'}.items(),
            ),
            *drivers,
        ]
    )
