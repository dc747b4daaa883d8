"""The ROS surface: each node is its parameters, its subscriptions, a push, a publish."""
