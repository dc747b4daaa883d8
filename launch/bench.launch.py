"""The analysis nodes of one bench: synchroniser, detector, fitter, compliance, recorder."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    bench = LaunchConfiguration('bench')
    parameters = [
        LaunchConfiguration('params_file'),
        {'use_sim_time': ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)},
    ]
    nodes = [
        Node(package='impactscope', executable=name, namespace=bench, parameters=parameters)
        for name in ('synchroniser', 'impact_detector', 'fitter', 'compliance')
    ]
    test_points = Node(
        package='impactscope',
        executable='test_points',
        namespace=bench,
        parameters=parameters,
        condition=IfCondition(LaunchConfiguration('test_points')),
    )
    recorder = Node(
        package='impactscope',
        executable='recorder',
        namespace=bench,
        parameters=[*parameters, {'path': LaunchConfiguration('record_to')}],
        condition=IfCondition(LaunchConfiguration('record')),
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument('bench', default_value='bench', description='namespace'),
            DeclareLaunchArgument(
                'params_file',
                default_value=PathJoinSubstitution(
                    [FindPackageShare('impactscope'), 'config', 'bench.yaml']
                ),
                description='parameters of all nodes of the bench',
            ),
            DeclareLaunchArgument('use_sim_time', default_value='false'),
            DeclareLaunchArgument('record', default_value='true', description='write a recording'),
            DeclareLaunchArgument(
                'record_to', default_value='', description='file; empty: named by the time'
            ),
            DeclareLaunchArgument(
                'test_points', default_value='true', description='services for test points'
            ),
            *nodes,
            test_points,
            recorder,
        ]
    )
