"""What carries the messages of this process: ROS 2 with DDS, or the queues of `ros/local`.

A run and a recorder are given a `Carrier`, and need not find out which of them it is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import contextmanager
from typing import TYPE_CHECKING, ClassVar, Protocol

import rclpy
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import MultiThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from barc_sim.errors import UserError
from barc_sim.ros.peers import has_dds

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from contextlib import AbstractContextManager

    from rclpy.executors import Executor
    from rclpy.node import Node

    from barc_sim.bags.messages import MessageFields
    from barc_sim.bags.recording_settings import Recording


class RecorderSubscriptions(Protocol):
    """The subscriptions of a recorder to the selected topics."""

    #: Whether messages that are not taken wait here, without a limit: then they need no cache.
    is_unlimited: bool

    @property
    def left_out(self) -> Mapping[str, str]:
        """Why a topic cannot be recorded, by its name."""

    def expect(self, name: str, type_name: str) -> None:
        """Subscribe to a selected topic before it has a publisher."""

    def discover(self) -> None:
        """Subscribe to each selected topic with a new publisher since the last call."""

    def call_when_full(self, write: Callable[[], object]) -> None:
        """Call `write` from now on when many messages wait in this process."""

    def take(self) -> list[MessageFields]:
        """Return the waiting messages; for one thread at a time."""

    def lost(self) -> dict[str, dict[str, int]]:
        """Return the number of lost messages, by topic and publishing node."""

    def unknown(self) -> dict[str, str]:
        """Return why more messages of a topic may be lost, by topic."""

    def close(self) -> None:
        """Destroy the subscriptions."""


class Carrier(ABC):
    """How nodes exchange messages, and which executor calls them back."""

    name: ClassVar[str]

    @abstractmethod
    def start(self, args: list[str], *, network: bool) -> AbstractContextManager[None]:
        """Initialise rclpy with `args`; with `network`, other machines discover its nodes.

        UserError: it cannot start with these arguments.
        """

    @abstractmethod
    def new_executor(self) -> Executor:
        """Return an executor of nodes."""

    @abstractmethod
    def new_subscriptions(self, node: Node, recording: Recording) -> RecorderSubscriptions:
        """Return the subscriptions of a recorder, which is `node`."""


class DdsCarrier(Carrier):
    """ROS 2: its rclpy, over DDS."""

    name = 'ROS 2 (rclpy)'

    def start(self, args: list[str], *, network: bool) -> AbstractContextManager[None]:
        """Initialise rclpy, with our settings of Fast DDS."""
        from barc_sim.ros.process import ros  # noqa: PLC0415 (needs ROS's rclpy)

        return ros(args, network=network)

    def new_executor(self) -> Executor:
        """Return our own executor."""
        from barc_sim.ros.process import new_executor  # noqa: PLC0415 (needs ROS's rclpy)

        return new_executor()

    def new_subscriptions(self, node: Node, recording: Recording) -> RecorderSubscriptions:
        """Return subscriptions that a thread polls."""
        from barc_sim.ros.recording.subscriptions import (  # noqa: PLC0415 (needs ROS's rclpy)
            TopicSubscriptions,
        )

        return TopicSubscriptions(node, recording)


class LocalCarrier(Carrier):
    """The stand-in for rclpy, `ros/local`, in one process without ROS."""

    name = 'local, without ROS'

    @contextmanager
    def start(self, args: list[str], *, network: bool) -> Iterator[None]:
        """Initialise the stand-in."""
        del network  # there is none
        try:
            rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        except RuntimeError as error:
            raise UserError(f'ROS cannot start with its arguments: {error}') from None
        try:
            yield
        except InvalidTopicNameException as error:  # ROS refuses it before the first node
            raise UserError(str(error)) from None
        finally:
            rclpy.try_shutdown()

    def new_executor(self) -> Executor:
        """Return the stand-in for an executor."""
        return MultiThreadedExecutor()

    def new_subscriptions(self, node: Node, recording: Recording) -> RecorderSubscriptions:
        """Return subscriptions that the publishers' threads fill."""
        from barc_sim.ros.local.recording import (  # noqa: PLC0415 (only without ROS)
            LocalSubscriptions,
        )

        return LocalSubscriptions(node, recording)


def find_carrier() -> Carrier:
    """Return the carrier of the imported rclpy."""
    return DdsCarrier() if has_dds() else LocalCarrier()
