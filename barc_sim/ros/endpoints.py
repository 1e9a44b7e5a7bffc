"""Publishers and subscriptions without the default QoS events.

The default event callbacks add two waitables to each endpoint, which every wait of an executor
would include; `incompatible_peers` finds mismatched QoS instead.
"""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING, Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import QoSCompatibility, qos_check_compatible

from barc_sim.ros.names import OF_EVERY_NODE, QOS
from barc_sim.ros.serialized import Taker

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.callback_groups import CallbackGroup
    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription


def publisher(node: Node, message_type: type[Any], topic: str) -> Publisher:
    """Return a publisher of `node` on `topic`.

    Examples
    --------
    >>> import rclpy
    >>> from barc_interfaces.msg import ECU
    >>> rclpy.init()
    >>> node = rclpy.create_node('driver', namespace='/car2')
    >>> publisher(node, ECU, 'ecu').topic_name
    '/car2/ecu'
    """
    events = PublisherEventCallbacks(use_default_callbacks=False)
    return node.create_publisher(message_type, topic, QOS, event_callbacks=events)


def subscription(
    node: Node,
    message_type: type[Any],
    topic: str,
    callback: Callable[[Any], None],
    group: CallbackGroup,
    *,
    qos: QoSProfile | int = QOS,
    raw: bool = False,
) -> Subscription:
    """Return a subscription of `node` to `topic`, whose callback runs in `group`.

    With `raw` it takes serialized messages.

    Examples
    --------
    >>> import rclpy
    >>> from std_msgs.msg import Float64
    >>> from barc_sim.ros.executor import QuickCallbackGroup, QuickExecutor
    >>> rclpy.init()
    >>> node, executor = rclpy.create_node('logger'), QuickExecutor()
    >>> executor.add_node(node)
    True
    >>> made = subscription(node, Float64, 'speed', lambda m: print(m.data), QuickCallbackGroup())
    >>> publisher(node, Float64, 'speed').publish(Float64(data=8.0))
    >>> executor.spin_once(timeout_sec=5.0)
    8.0
    """
    events = SubscriptionEventCallbacks(use_default_callbacks=False)
    return node.create_subscription(
        message_type, topic, callback, qos, callback_group=group, event_callbacks=events, raw=raw
    )


def drained_subscription(
    node: Node,
    message_type: type[Any],
    topic: str,
    callback: Callable[[bytes], None],
    group: CallbackGroup,
) -> Callable[[], None]:
    """Subscribe `node` to `topic`; each wake-up passes all waiting messages to `callback`.

    Draining the queue finds the newest message even under a flood. Messages are serialized.
    Calling the result drains the queue at once, without waiting for the executor.

    Examples
    --------
    >>> import rclpy
    >>> from rclpy.serialization import deserialize_message
    >>> from std_msgs.msg import Float64
    >>> from barc_sim.ros.executor import QuickCallbackGroup
    >>> rclpy.init()
    >>> node, speeds = rclpy.create_node('logger'), []
    >>> take = lambda data: speeds.append(deserialize_message(data, Float64).data)
    >>> drain = drained_subscription(node, Float64, 'speed', take, QuickCallbackGroup())
    >>> sender = publisher(node, Float64, 'speed')
    >>> for speed in (7.9, 8.0, 8.1):
    ...     sender.publish(Float64(data=speed))
    >>> drain()
    >>> speeds
    [7.9, 8.0, 8.1]
    """
    taker = Taker(node)

    def drain() -> None:
        for taken in islice(taker.take(made), QOS.depth):
            callback(taken.data)

    def on_message(data: bytes) -> None:
        callback(data)
        drain()

    made = subscription(node, message_type, topic, on_message, group, raw=True)
    return drain


def incompatible_peers(node: Node) -> Iterator[str]:
    """Yield a sentence for each pair of endpoints on a topic of `node` whose QoS does not match.

    The topics that every node has are left out: comparing them takes longer the more nodes run.

    Examples
    --------
    >>> import rclpy
    >>> from std_msgs.msg import Float64
    >>> from barc_sim.ros.names import QOS_NEWEST
    >>> rclpy.init()
    >>> node = rclpy.create_node('logger')
    >>> lossy = node.create_publisher(Float64, 'speed', rclpy.qos.qos_profile_sensor_data)
    >>> reliable = node.create_subscription(Float64, 'speed', print, QOS_NEWEST)
    >>> [sentence.partition(':')[0] for sentence in incompatible_peers(node)]
    ['logger cannot receive /speed from logger']
    """
    used = {end.topic_name for end in (*node.publishers, *node.subscriptions)}
    for topic in sorted(used - OF_EVERY_NODE):
        subscribers = node.get_subscriptions_info_by_topic(topic)
        for source in node.get_publishers_info_by_topic(topic):
            for sink in subscribers:
                verdict, reason = qos_check_compatible(source.qos_profile, sink.qos_profile)
                if verdict == QoSCompatibility.ERROR:
                    yield (
                        f'{sink.node_name} cannot receive {topic} from {source.node_name}: {reason}'
                    )
