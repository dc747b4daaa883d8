"""Nodes under test: spun in a thread, listened to, with real DDS in between."""

import threading
import time
from contextlib import contextmanager

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future


@contextmanager
def ros():
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()


@contextmanager
def spinning(*nodes):
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    stop = Future()

    def spin():
        while not stop.done():
            executor.spin_until_future_complete(stop, timeout_sec=0.1)

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set_result(None)
        thread.join()
        for node in nodes:
            node.destroy_node()


def options(namespace='bench', **parameters):
    """Keywords for a node; dots in names are written as two underscores."""
    return {
        'namespace': namespace,
        'parameter_overrides': [
            Parameter(name.replace('__', '.'), value=value) for name, value in parameters.items()
        ],
    }


class Ear(Node):
    """Keeps what it hears."""

    def __init__(self, **topics):
        super().__init__('ear', namespace='bench')
        self.heard = {name: [] for name in topics}
        for name, (kind, profile) in topics.items():
            self.create_subscription(
                kind, name.replace('__', '/'), self.heard[name].append, profile
            )


def eventually(condition, timeout=20.0):
    """Wait until a condition holds; its last value."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        if value := condition():
            return value
        time.sleep(0.02)
    return condition()
